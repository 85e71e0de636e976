<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="fr" sourcelanguage="en">
<context>
    <name>ApplyReviews</name>
    <message>
        <location filename="../algorithms/review.py" line="24" />
        <source>Apply reviews</source>
        <translation>Appliquer les décisions</translation>
    </message>
    <message>
        <location filename="../algorithms/review.py" line="27" />
        <source>Writes a result again with the decisions that were made in the review panel.

Buildings that were confirmed or corrected get the status “reviewed” and the reviewed height; buildings that were marked as wrong get the status “unknown”. All files of the folder are written again; heights are not computed again.

The decisions stay in reviews.geojson in the folder, and count for later runs into it too.</source>
        <translation>Réécrit un résultat avec les décisions prises dans le panneau de vérification.

Les bâtiments confirmés ou corrigés reçoivent le statut « reviewed » et la hauteur vérifiée ; ceux qui sont marqués comme faux reçoivent le statut « unknown ». Tous les fichiers du dossier sont réécrits ; les hauteurs ne sont pas recalculées.

Les décisions restent dans reviews.geojson, dans le dossier, et valent aussi pour les calculs suivants dans ce dossier.</translation>
    </message>
    <message>
        <location filename="../algorithms/review.py" line="38" />
        <source>Folder of the results</source>
        <translation>Dossier des résultats</translation>
    </message>
    <message>
        <location filename="../algorithms/review.py" line="41" />
        <source>Load the results, styled, as a group</source>
        <translation>Charger les résultats en groupe</translation>
    </message>
    <message>
        <location filename="../algorithms/review.py" line="44" />
        <source>GeoPackage</source>
        <translation>GeoPackage</translation>
    </message>
    <message>
        <location filename="../algorithms/review.py" line="45" />
        <source>Exit code</source>
        <translation>Code de sortie</translation>
    </message>
    <message>
        <location filename="../algorithms/review.py" line="52" />
        <source>{} is not there.</source>
        <translation>{} n'existe pas.</translation>
    </message>
    <message>
        <location filename="../algorithms/review.py" line="64" />
        <source>Some buildings have no height: see the layer qa_issues.</source>
        <translation>Certains bâtiments n'ont pas de hauteur : voir la couche qa_issues.</translation>
    </message>
</context>
<context>
    <name>CityFromFolder</name>
    <message>
        <location filename="../algorithms/city.py" line="34" />
        <source>City from a folder of photos</source>
        <translation>Ville à partir d'un dossier de photos</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="37" />
        <source>Makes a 3D city from a folder of photos and building footprints.

Choose the folder of the photos, the footprints, and a folder for the results. The poses may be in the photos (DJI and other drones) or in files beside them: ODM, Metashape, Pix4D, COLMAP and others. The program finds the poses, the CRS, the heights and the ground. The log lists what it found, and what you should know of it.

A terrain model (DTM) makes heights better. Put it into the folder of the photos, or choose it here. Without one, the program finds the ground in the photos.

If something is missing, nothing is computed, and the message says what to add. “Only look at the folder” stops before anything is computed.

The settings are written to input/sizeup.toml in the folder of the results. “Inspect survey” and “Estimate heights” can start from that file.</source>
        <translation>Crée une ville 3D à partir d'un dossier de photos et d'emprises de bâtiments.

Choisissez le dossier des photos, les emprises et un dossier pour les résultats. Les orientations peuvent se trouver dans les photos (DJI et autres drones) ou dans des fichiers voisins : ODM, Metashape, Pix4D, COLMAP et autres. Le programme trouve les orientations, le SCR, les altitudes et le sol. Le journal indique ce qu'il a trouvé et ce qu'il faut en savoir.

Un modèle de terrain (MNT) améliore les hauteurs. Placez-le dans le dossier des photos ou choisissez-le ici. Sans lui, le programme trouve le sol dans les photos.

S'il manque quelque chose, rien n'est calculé et le message dit ce qu'il faut ajouter. « Examiner seulement le dossier » s'arrête avant tout calcul.

Les paramètres sont écrits dans input/sizeup.toml, dans le dossier des résultats. « Examiner le vol » et « Estimer les hauteurs » peuvent partir de ce fichier.</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="55" />
        <source>Folder of the photos</source>
        <translation>Dossier des photos</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="58" />
        <source>Building footprints</source>
        <translation>Emprises des bâtiments</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="58" />
        <source>If empty: those in the folder</source>
        <translation>Si vide : celles du dossier</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="64" />
        <source>Field of the buildings' ids</source>
        <translation>Champ des identifiants</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="64" />
        <source>If empty: the program chooses</source>
        <translation>Si vide : le programme choisit</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="70" />
        <source>Only look at the folder</source>
        <translation>Examiner seulement le dossier</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="70" />
        <source>Computes nothing</source>
        <translation>Ne calcule rien</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="74" />
        <source>Terrain model (DTM)</source>
        <translation>Modèle de terrain (MNT)</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="75" />
        <source>Height of the ground, metres</source>
        <translation>Altitude du sol, mètres</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="78" />
        <source>CRS of the results</source>
        <translation>SCR des résultats</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="78" />
        <source>Projected, in metres</source>
        <translation>Projeté, en mètres</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="81" />
        <source>Offset of the poses: x, y, z</source>
        <translation>Décalage des orientations</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="81" />
        <source>Metres, which the program that wrote the poses took off them</source>
        <translation>Mètres que le programme qui a écrit les orientations en a retranchés</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="86" />
        <source>Settings</source>
        <translation>Paramètres</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="93" />
        <source>The folder of the photos {} is not there.</source>
        <translation>Le dossier des photos {} n'existe pas.</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="116" />
        <source>Give a terrain model or a height of the ground, one of the two.</source>
        <translation>Indiquez soit un modèle de terrain, soit une altitude du sol.</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="139" />
        <source>Nothing is missing. The settings are in {}.</source>
        <translation>Il ne manque rien. Les paramètres sont dans {}.</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="168" />
        <source>Photos</source>
        <translation>Photos</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="168" />
        <source>{} photos, {} with a usable pose: {} straight down, {} oblique</source>
        <translation>{} photos, dont {} avec une orientation utilisable : {} verticales, {} obliques</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="170" />
        <source>Poses</source>
        <translation>Orientations</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="171" />
        <source>CRS</source>
        <translation>SCR</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="172" />
        <source>Heights</source>
        <translation>Altitudes</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="173" />
        <source>Footprints</source>
        <translation>Emprises</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="174" />
        <source>Ground</source>
        <translation>Sol</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="180" />
        <source>Missing: {}.</source>
        <translation>Il manque : {}.</translation>
    </message>
</context>
<context>
    <name>CompareResults</name>
    <message>
        <location filename="../algorithms/changes.py" line="26" />
        <source>What changed</source>
        <translation>Ce qui a changé</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="29" />
        <source>Tells what changed between two results: new, gone, raised, lowered, footprint changed, same, or unsure.

Buildings are matched by place, so their ids need not be the same: the new ones are kept, and the old ones stand beside them. A difference counts where both standard deviations do not explain it; where they are too wide to tell, the building is unsure. What is common to all buildings (a flight whose poses are a little off) is taken off and told.

Each result is the city.gpkg of a run, or its CityJSON. The layer has a row per building, with the reason in words.</source>
        <translation>Compare deux résultats : nouveau, disparu, surélevé, abaissé, emprise modifiée, identique ou incertain.

Les bâtiments sont appariés par leur position, leurs identifiants peuvent donc différer : les nouveaux sont conservés, les anciens figurent à côté. Une différence compte si les deux écarts-types ne l'expliquent pas ; s'ils sont trop grands, le bâtiment est incertain. Ce qui est commun à tous les bâtiments (un vol aux orientations un peu décalées) est retranché et indiqué.

Chaque résultat est le city.gpkg d'un calcul, ou son CityJSON. La couche a une ligne par bâtiment, avec la raison en toutes lettres.</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="41" />
        <source>Earlier result</source>
        <translation>Résultat antérieur</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="42" />
        <source>Later result</source>
        <translation>Résultat postérieur</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="43" />
        <source>Least difference, metres</source>
        <translation>Plus petit écart, mètres</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="47" />
        <source>Load the layer, styled</source>
        <translation>Charger la couche stylée</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="50" />
        <source>Earlier sigma, metres</source>
        <translation>Sigma antérieur, mètres</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="50" />
        <source>Later sigma, metres</source>
        <translation>Sigma postérieur, mètres</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="51" />
        <source>Standard deviation of heights whose file states none</source>
        <translation>Écart-type des hauteurs dont le fichier n'en indique pas</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="57" />
        <source>Compare heights above ground only</source>
        <translation>Comparer les hauteurs au sol seules</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="57" />
        <source>Levels of roofs are not compared</source>
        <translation>Les altitudes des toits ne sont pas comparées</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="61" />
        <source>Keep a common difference</source>
        <translation>Garder l'écart commun</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="61" />
        <source>What all buildings have in common counts as change, too</source>
        <translation>Ce qui est commun à tous les bâtiments compte aussi comme changement</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="65" />
        <source>Folder of the comparison</source>
        <translation>Dossier de la comparaison</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="66" />
        <source>Number of buildings that have changed</source>
        <translation>Nombre de bâtiments modifiés</translation>
    </message>
</context>
<context>
    <name>EstimateHeights</name>
    <message>
        <location filename="../algorithms/heights.py" line="21" />
        <source>Estimate heights</source>
        <translation>Estimer les hauteurs</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="24" />
        <source>Finds one height per building footprint in oblique photos, and writes a LOD1 city: GeoPackage, CityJSON, report.

It takes photos with known poses, building footprints, and the ground: a terrain model, not a surface model, or one height where it is flat. Footprints may be in any CRS; results are in the CRS that is chosen here, projected and in metres. Of a layer with a filter or a selection, what is filtered or selected is taken.

Depth of the photos comes from:
- “automatic”: a network where one is named and in place, else stereo
- “stereo”: the photos matched with each other
- “files”: one depth map per photo, priors/{stem}.npy, from any network
- “network”: an ONNX file, or the name of one that `sizeup model get` has put in place

The layers are loaded styled: buildings by height, doubtful ones hatched, issues as points, cameras. Open report.html in the folder for photos and evidence, and look at doubtful buildings with Plugins &gt; sizeup &gt; Review buildings. Decisions that lie in the folder (reviews.geojson) are applied when it is run again.

Where it is stopped, nothing is loaded, and every file in the folder is whole, of this run or the one before.</source>
        <translation>Trouve une hauteur par emprise de bâtiment dans des photos obliques et écrit une ville LOD1 : GeoPackage, CityJSON, rapport.

Il faut des photos aux orientations connues, des emprises de bâtiments et le sol : un modèle de terrain (pas de surface), ou une altitude s'il est plat. Les emprises peuvent être dans n'importe quel SCR ; les résultats sont dans le SCR choisi ici, projeté et en mètres. D'une couche filtrée ou avec une sélection, seul ce qui est filtré ou sélectionné est pris.

La profondeur des photos vient :
- « automatique » : d'un réseau s'il est nommé et en place, sinon de la stéréo
- « stéréo » : de la mise en correspondance des photos
- « fichiers » : d'une carte de profondeur par photo, priors/{stem}.npy, de n'importe quel réseau
- « un réseau » : d'un fichier ONNX, ou du nom d'un réseau mis en place par `sizeup model get`

Les couches sont chargées avec leur style : bâtiments par hauteur, douteux hachurés, remarques en points, caméras. Ouvrez report.html dans le dossier pour les photos et les preuves, et vérifiez les bâtiments douteux avec Extensions &gt; sizeup &gt; Vérifier les bâtiments. Les décisions du dossier (reviews.geojson) sont appliquées au prochain calcul.

Après une interruption rien n'est chargé, et chaque fichier du dossier est entier, de ce calcul ou du précédent.</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="47" />
        <source>Building footprints</source>
        <translation>Emprises des bâtiments</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="49" />
        <source>Depth comes from</source>
        <translation>La profondeur vient de</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="49" />
        <source>automatic</source>
        <translation>automatique</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="49" />
        <source>stereo</source>
        <translation>stéréo</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="49" />
        <source>files</source>
        <translation>fichiers</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="49" />
        <source>a network</source>
        <translation>un réseau</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="53" />
        <source>Files: path with {stem}</source>
        <translation>Fichiers : chemin avec {stem}</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="53" />
        <source>{stem} stands for the name of the photo, as in priors/{stem}.npy</source>
        <translation>{stem} remplace le nom de la photo, comme dans priors/{stem}.npy</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="57" />
        <source>Files: numbers are</source>
        <translation>Fichiers : les nombres sont</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="57" />
        <source>depth (higher is farther)</source>
        <translation>profondeur (grand : loin)</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="57" />
        <source>inverse depth (higher is nearer)</source>
        <translation>profondeur inverse (grand : près)</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="61" />
        <source>Network: ONNX file or name</source>
        <translation>Réseau : fichier ONNX ou nom</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="64" />
        <source>Network: profile</source>
        <translation>Réseau : profil</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="64" />
        <source>If empty: by the name of the network</source>
        <translation>Si vide : d'après le nom du réseau</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="70" />
        <source>Vertical reference</source>
        <translation>Référence verticale</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="70" />
        <source>What heights count from, in words: DHHN2016, NAP, …</source>
        <translation>D'où partent les altitudes, en mots : IGN69, NAP, …</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="90" />
        <source>Choose a layer of building footprints.</source>
        <translation>Choisissez une couche d'emprises de bâtiments.</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="92" />
        <source>Give a terrain model, or one height of the ground. “City from a folder of photos” finds the ground itself.</source>
        <translation>Indiquez un modèle de terrain ou une altitude du sol. « Ville à partir d'un dossier de photos » trouve le sol elle-même.</translation>
    </message>
</context>
<context>
    <name>ExportCity</name>
    <message>
        <location filename="../algorithms/export.py" line="34" />
        <source>Export</source>
        <translation>Exporter</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="37" />
        <source>Writes a city in another format: CityJSON, CityJSONSeq, GeoPackage, FlatGeobuf, FlatCityBuf, GeoJSON, CityGML, OBJ, STL, DXF, KML, CSV, 3D Tiles.

The input is a result of sizeup, or anybody's CityJSON with heights. 3D Tiles are a folder; they need to know how high the geoid is above the ellipsoid there, if the CRS does not say what heights count from.

Cameras and issues are only in the files of a run: an export has the buildings with all their attributes.</source>
        <translation>Écrit une ville dans un autre format : CityJSON, CityJSONSeq, GeoPackage, FlatGeobuf, FlatCityBuf, GeoJSON, CityGML, OBJ, STL, DXF, KML, CSV, 3D Tiles.

L'entrée est un résultat de sizeup, ou tout CityJSON avec des hauteurs. Les 3D Tiles sont un dossier ; il faut connaître la hauteur du géoïde au-dessus de l'ellipsoïde si le SCR ne dit pas d'où partent les altitudes.

Les caméras et les remarques ne sont que dans les fichiers d'un calcul : un export contient les bâtiments avec tous leurs attributs.</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="48" />
        <source>City</source>
        <translation>Ville</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="51" />
        <source>Format</source>
        <translation>Format</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="51" />
        <source>OBJ (modelling)</source>
        <translation>OBJ (modélisation)</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="51" />
        <source>STL (printers)</source>
        <translation>STL (impression 3D)</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="51" />
        <source>DXF (CAD)</source>
        <translation>DXF (CAO)</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="51" />
        <source>KML (globes)</source>
        <translation>KML (globes)</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="51" />
        <source>CSV (tables)</source>
        <translation>CSV (tableaux)</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="51" />
        <source>3D Tiles (a folder)</source>
        <translation>3D Tiles (un dossier)</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="59" />
        <source>CRS, if the city states none</source>
        <translation>SCR, si la ville n'en indique pas</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="60" />
        <source>CityJSON: names of attributes</source>
        <translation>CityJSON : noms des attributs</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="63" />
        <source>3D Tiles: geoid height, metres</source>
        <translation>3D Tiles : géoïde, mètres</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="63" />
        <source>Of the geoid, or the national zero, above the ellipsoid</source>
        <translation>Du géoïde, ou du zéro national, au-dessus de l'ellipsoïde</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="67" />
        <source>Load the file</source>
        <translation>Charger le fichier</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="68" />
        <source>File, or folder of 3D Tiles</source>
        <translation>Fichier, ou dossier de 3D Tiles</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="78" />
        <source>{} is open in this project: choose another name.</source>
        <translation>{} est ouvert dans ce projet : choisissez un autre nom.</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="108" />
        <source>QGIS reads CityJSON and 3D Tiles through other plugins or newer versions.</source>
        <translation>QGIS lit CityJSON et 3D Tiles avec d'autres extensions ou des versions plus récentes.</translation>
    </message>
</context>
<context>
    <name>FindFootprints</name>
    <message>
        <location filename="../algorithms/footprints.py" line="27" />
        <source>Footprints from photos</source>
        <translation>Emprises à partir de photos</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="30" />
        <source>Finds building footprints in the nadir photos, lays them on the ground and makes one footprint per building.

It takes masks that another tool has made (one image per photo, or one COCO file), or runs a segmentation network (ONNX). In the masks' path {stem} stands for the photo's name without extension: masks/{stem}.png

Kinds of masks: “instance”, every building has its own number; “semantic”, building or not; “probability”; “coco”, one JSON file. Row houses stay apart only where masks tell them apart.

With a cadastre, ids and attributes of known buildings are kept, and what is new or gone is marked.

The result is footprints.gpkg, styled by how sure each footprint is, and pictures of the photos with the footprints drawn over them.</source>
        <translation>Trouve des emprises de bâtiments dans les photos verticales, les pose sur le sol et fait une emprise par bâtiment.

Il prend des masques faits par un autre outil (une image par photo, ou un fichier COCO), ou utilise un réseau de segmentation (ONNX). Dans le chemin des masques, {stem} remplace le nom de la photo sans extension : masks/{stem}.png

Types de masques : « instance », chaque bâtiment a son numéro ; « semantic », bâtiment ou non ; « probability » ; « coco », un fichier JSON. Les maisons en bande ne restent séparées que si les masques les séparent.

Avec un cadastre, les identifiants et attributs des bâtiments connus sont conservés, et ce qui est nouveau ou disparu est marqué.

Le résultat est footprints.gpkg, stylé selon la certitude de chaque emprise, et des images des photos avec les emprises dessinées.</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="48" />
        <source>Footprints come from</source>
        <translation>Les emprises viennent de</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="48" />
        <source>masks of the nadir photos</source>
        <translation>masques des photos verticales</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="48" />
        <source>a segmentation network</source>
        <translation>un réseau de segmentation</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="52" />
        <source>Masks: path with {stem}</source>
        <translation>Masques : chemin avec {stem}</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="52" />
        <source>{stem} stands for the name of the photo, as in masks/{stem}.png</source>
        <translation>{stem} remplace le nom de la photo, comme dans masks/{stem}.png</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="56" />
        <source>Masks: kind</source>
        <translation>Masques : type</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="59" />
        <source>Network: ONNX file</source>
        <translation>Réseau : fichier ONNX</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="62" />
        <source>Network: profile</source>
        <translation>Réseau : profil</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="65" />
        <source>Cadastre whose ids are kept</source>
        <translation>Cadastre des identifiants</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="68" />
        <source>Folder of the results</source>
        <translation>Dossier des résultats</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="69" />
        <source>GeoPackage of the footprints</source>
        <translation>GeoPackage des emprises</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="70" />
        <source>Exit code</source>
        <translation>Code de sortie</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="79" />
        <source>Say where the masks are, as in masks/{stem}.png.</source>
        <translation>Indiquez où sont les masques, comme dans masks/{stem}.png.</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="81" />
        <source>Name the network's ONNX file.</source>
        <translation>Indiquez le fichier ONNX du réseau.</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="83" />
        <source>Give a terrain model, or one height of the ground.</source>
        <translation>Indiquez un modèle de terrain ou une altitude du sol.</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="105" />
        <source>Some photos could not be used: see issues.json in the folder.</source>
        <translation>Certaines photos n'ont pas pu servir : voir issues.json dans le dossier.</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="112" />
        <source>Cannot load {}</source>
        <translation>Impossible de charger {}</translation>
    </message>
</context>
<context>
    <name>Footprints</name>
    <message>
        <location filename="../layers.py" line="43" />
        <source>The layer “{}” has unsaved edits: save or discard them first.</source>
        <translation>La couche « {} » a des modifications non enregistrées : enregistrez-les ou annulez-les d'abord.</translation>
    </message>
    <message>
        <location filename="../layers.py" line="47" />
        <source>The layer “{}” has no CRS: set it in Layer Properties &gt; Source.</source>
        <translation>La couche « {} » n'a pas de SCR : définissez-le dans Propriétés de la couche &gt; Source.</translation>
    </message>
    <message>
        <location filename="../layers.py" line="81" />
        <source>Cannot write {}: {}</source>
        <translation>Impossible d'écrire {} : {}</translation>
    </message>
    <message>
        <location filename="../layers.py" line="85" />
        <source>The layer “{}” has no features to read.</source>
        <translation>La couche « {} » n'a pas d'entités.</translation>
    </message>
</context>
<context>
    <name>InspectSurvey</name>
    <message>
        <location filename="../algorithms/inspect.py" line="21" />
        <source>Inspect survey</source>
        <translation>Examiner le vol</translation>
    </message>
    <message>
        <location filename="../algorithms/inspect.py" line="24" />
        <source>Says whether the photos' poses look right, before anything is computed from them.

Loads three layers: where the cameras are, where they look, and what part of the ground each photo shows. If these lie beside your footprints, the CRS, the offset or the reading of the angles is wrong; the report says which other reading looks better.

Give the ground (a terrain model or one height) and the footprints too: both tell more of the poses.

A table of poses needs to say what its angles mean, under “Further settings”: survey.csv.angles=opk and so on.</source>
        <translation>Vérifie si les orientations des photos semblent justes, avant tout calcul.

Charge trois couches : positions des caméras, directions de visée et partie du sol que chaque photo montre. Si elles sont à côté de vos emprises, le SCR, le décalage ou la lecture des angles est faux ; le rapport dit quelle autre lecture convient mieux.

Indiquez aussi le sol (un modèle de terrain ou une altitude) et les emprises : les deux en disent plus sur les orientations.

Un tableau d'orientations doit dire ce que signifient ses angles, sous « Autres paramètres » : survey.csv.angles=opk, etc.</translation>
    </message>
    <message>
        <location filename="../algorithms/inspect.py" line="40" />
        <source>Building footprints</source>
        <translation>Emprises des bâtiments</translation>
    </message>
    <message>
        <location filename="../algorithms/inspect.py" line="43" />
        <source>Folder of the report</source>
        <translation>Dossier du rapport</translation>
    </message>
    <message>
        <location filename="../algorithms/inspect.py" line="44" />
        <source>The poses look right</source>
        <translation>Les orientations semblent justes</translation>
    </message>
    <message>
        <location filename="../algorithms/inspect.py" line="46" />
        <source>Report</source>
        <translation>Rapport</translation>
    </message>
    <message>
        <location filename="../algorithms/inspect.py" line="47" />
        <source>Map of the survey</source>
        <translation>Carte du vol</translation>
    </message>
    <message>
        <location filename="../algorithms/inspect.py" line="48" />
        <source>GeoPackage of cameras and image footprints</source>
        <translation>GeoPackage des caméras et emprises d'images</translation>
    </message>
    <message>
        <location filename="../algorithms/inspect.py" line="75" />
        <source>The poses look wrong: see the report above.</source>
        <translation>Les orientations semblent fausses : voir le rapport ci-dessus.</translation>
    </message>
    <message>
        <location filename="../algorithms/inspect.py" line="89" />
        <source>Cannot load {}</source>
        <translation>Impossible de charger {}</translation>
    </message>
</context>
<context>
    <name>PhotoView</name>
    <message>
        <location filename="../review/photo.py" line="99" />
        <source>No photo</source>
        <translation>Pas de photo</translation>
    </message>
</context>
<context>
    <name>ReviewDock</name>
    <message>
        <location filename="../review/dock.py" line="74" />
        <source>The result: buildings of a city.gpkg in the project</source>
        <translation>Le résultat : bâtiments d'un city.gpkg du projet</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="77" />
        <source>doubtful and without a height</source>
        <translation>douteux et sans hauteur</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="77" />
        <source>the same, without a decision yet</source>
        <translation>les mêmes, encore sans décision</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="77" />
        <source>all buildings</source>
        <translation>tous les bâtiments</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="82" />
        <source>Result</source>
        <translation>Résultat</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="83" />
        <source>Show</source>
        <translation>Afficher</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="104" />
        <source>Apply to the result…</source>
        <translation>Appliquer au résultat…</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="105" />
        <source>Writes the result again with the decisions; heights are not computed again</source>
        <translation>Réécrit le résultat avec les décisions ; les hauteurs ne sont pas recalculées</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="117" />
        <source>Building before (Page Up)</source>
        <translation>Bâtiment précédent (Page préc.)</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="118" />
        <source>Next building (Page Down)</source>
        <translation>Bâtiment suivant (Page suiv.)</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="130" />
        <source>Photo before</source>
        <translation>Photo précédente</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="131" />
        <source>Next photo</source>
        <translation>Photo suivante</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="145" />
        <source>Height above the ground; the block in the photo follows</source>
        <translation>Hauteur au-dessus du sol ; le bloc dans la photo suit</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="148" />
        <source>why, if you like</source>
        <translation>raison, si vous voulez</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="151" />
        <source>Height</source>
        <translation>Hauteur</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="152" />
        <source>Note</source>
        <translation>Note</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="153" />
        <source>By</source>
        <translation>Par</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="154" />
        <source>Confirm</source>
        <translation>Confirmer</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="155" />
        <source>The height that was found is right</source>
        <translation>La hauteur trouvée est juste</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="157" />
        <source>Correct height</source>
        <translation>Corriger</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="158" />
        <source>The height above is right</source>
        <translation>La hauteur ci-dessus est juste</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="160" />
        <source>Wrong</source>
        <translation>Faux</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="161" />
        <source>The height is wrong, and the right one is not known</source>
        <translation>La hauteur est fausse et la bonne n'est pas connue</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="163" />
        <source>Undo</source>
        <translation>Annuler</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="164" />
        <source>Takes the decision about this building back</source>
        <translation>Retire la décision sur ce bâtiment</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="226" />
        <source>measured</source>
        <translation>mesuré</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="226" />
        <source>given</source>
        <translation>donné</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="226" />
        <source>doubtful</source>
        <translation>douteux</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="227" />
        <source>from a fallback</source>
        <translation>valeur de repli</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="278" />
        <source>height not known</source>
        <translation>hauteur inconnue</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="228" />
        <source>footprint refused</source>
        <translation>emprise refusée</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="228" />
        <source>reviewed</source>
        <translation>vérifié</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="233" />
        <source>wrong</source>
        <translation>faux</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="234" />
        <source>confirmed</source>
        <translation>confirmé</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="234" />
        <source>corrected</source>
        <translation>corrigé</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="252" />
        <source>{} of {}</source>
        <translation>{} sur {}</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="252" />
        <source>none</source>
        <translation>aucun</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="268" />
        <source>Load a result first: its layer “buildings”.</source>
        <translation>Chargez d'abord un résultat : sa couche « buildings ».</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="268" />
        <source>Nothing to look at: every building is measured, or has a decision.</source>
        <translation>Rien à vérifier : chaque bâtiment est mesuré ou décidé.</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="298" />
        <source>No photo of this building is at hand: the survey names no photo files, or they are not where they were.</source>
        <translation>Aucune photo de ce bâtiment n'est disponible : le vol ne nomme pas de fichiers, ou ils ne sont plus à leur place.</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="302" />
        <source>photo {} of {}</source>
        <translation>photo {} sur {}</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="352" />
        <source>The decision cannot be kept: {}</source>
        <translation>La décision ne peut pas être enregistrée : {}</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="354" />
        <source>{} decisions in {}</source>
        <translation>{} décisions dans {}</translation>
    </message>
</context>
<context>
    <name>SizeupAlgorithm</name>
    <message>
        <location filename="../algorithms/base.py" line="129" />
        <source>Stopped. Nothing is loaded; every file is whole, or absent.</source>
        <translation>Interrompu. Rien n'est chargé ; chaque fichier est entier ou absent.</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="131" />
        <source>The files in {} are of two runs: run it again.</source>
        <translation>Les fichiers de {} viennent de deux calculs : relancez.</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="158" />
        <source>The program's answer cannot be read: {}</source>
        <translation>La réponse du programme est illisible : {}</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="163" />
        <source>Reading the survey</source>
        <translation>Lecture du vol</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="163" />
        <source>Laying footprints on the ground</source>
        <translation>Pose des emprises sur le sol</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="164" />
        <source>Finding heights</source>
        <translation>Recherche des hauteurs</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="164" />
        <source>Writing the results</source>
        <translation>Écriture des résultats</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="165" />
        <source>Looking for the ground in the photos</source>
        <translation>Recherche du sol dans les photos</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="165" />
        <source>Looking at the photos</source>
        <translation>Examen des photos</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="166" />
        <source>Aligning the poses with the photos</source>
        <translation>Ajustement des orientations aux photos</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="171" />
        <source>{} min</source>
        <translation>{} min</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="171" />
        <source>{} s</source>
        <translation>{} s</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="172" />
        <source>{} (about {} left)</source>
        <translation>{} (encore {} environ)</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="179" />
        <source>Cannot load {}</source>
        <translation>Impossible de charger {}</translation>
    </message>
</context>
<context>
    <name>SizeupPlugin</name>
    <message>
        <location filename="../plugin.py" line="35" />
        <source>City from a folder of photos…</source>
        <translation>Ville à partir d'un dossier de photos…</translation>
    </message>
    <message>
        <location filename="../plugin.py" line="38" />
        <source>Estimate heights…</source>
        <translation>Estimer les hauteurs…</translation>
    </message>
    <message>
        <location filename="../plugin.py" line="39" />
        <source>Review buildings</source>
        <translation>Vérifier les bâtiments</translation>
    </message>
</context>
<context>
    <name>Speaks</name>
    <message>
        <location filename="../layers.py" line="120" />
        <source>The terrain model “{}” is not a file: save it with Layer &gt; Save As… as a GeoTIFF first, and choose that.</source>
        <translation>Le modèle de terrain « {} » n'est pas un fichier : enregistrez-le d'abord en GeoTIFF avec Couche &gt; Enregistrer sous…, et choisissez celui-ci.</translation>
    </message>
    <message>
        <location filename="../layers.py" line="130" />
        <source>No CRS: choose a projected one in metres, such as EPSG:25832.</source>
        <translation>Pas de SCR : choisissez-en un projeté en mètres, comme EPSG:2154.</translation>
    </message>
    <message>
        <location filename="../layers.py" line="132" />
        <source>{} is geographic: its unit is a degree. Choose a projected CRS in metres, such as the UTM zone of the place; the layers themselves may stay as they are.</source>
        <translation>{} est géographique : son unité est le degré. Choisissez un SCR projeté en mètres, comme la zone UTM du lieu ; les couches peuvent rester telles quelles.</translation>
    </message>
    <message>
        <location filename="../layers.py" line="140" />
        <source>The unit of {} is {}: choose a projected CRS in metres.</source>
        <translation>L'unité de {} est {} : choisissez un SCR projeté en mètres.</translation>
    </message>
    <message>
        <location filename="../results.py" line="55" />
        <source>The layer “{}” of {} is being edited: end that first, the folder's files are to be replaced.</source>
        <translation>La couche « {} » de {} est en cours d'édition : terminez d'abord, les fichiers du dossier vont être remplacés.</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="51" />
        <source>Review buildings</source>
        <translation>Vérifier les bâtiments</translation>
    </message>
    <message>
        <location filename="../settings.py" line="14" />
        <source>sizeup program (empty: the one on the path)</source>
        <translation>programme sizeup (vide : celui du chemin)</translation>
    </message>
</context>
<context>
    <name>SurveyAlgorithm</name>
    <message>
        <location filename="../algorithms/base.py" line="198" />
        <source>Settings</source>
        <translation>Paramètres</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="198" />
        <source>Written by “City from a folder of photos”. Then nothing else is needed.</source>
        <translation>Écrits par « Ville à partir d'un dossier de photos ». Rien d'autre n'est alors nécessaire.</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="205" />
        <source>Poses: folder</source>
        <translation>Orientations : dossier</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="205" />
        <source>The folder of a model (COLMAP, OpenSfM), or of photos with poses</source>
        <translation>Le dossier d'un modèle (COLMAP, OpenSfM), ou de photos avec orientations</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="211" />
        <source>… or poses: file</source>
        <translation>… ou fichier</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="211" />
        <source>XML, CSV, JSON and others</source>
        <translation>XML, CSV, JSON et autres</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="215" />
        <source>Folder of the photos</source>
        <translation>Dossier des photos</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="218" />
        <source>CRS of the results</source>
        <translation>SCR des résultats</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="218" />
        <source>Projected, in metres</source>
        <translation>Projeté, en mètres</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="224" />
        <source>Terrain model (DTM)</source>
        <translation>Modèle de terrain (MNT)</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="225" />
        <source>… or one ground height, metres</source>
        <translation>… ou une altitude du sol, m</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="235" />
        <source>Field of the buildings' ids</source>
        <translation>Champ des identifiants</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="241" />
        <source>CRS of the poses, if another</source>
        <translation>SCR des orientations</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="242" />
        <source>Offset of the poses: x, y, z</source>
        <translation>Décalage des orientations</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="242" />
        <source>Metres, added to the poses</source>
        <translation>Mètres ajoutés aux orientations</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="250" />
        <source>Further settings</source>
        <translation>Autres paramètres</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="250" />
        <source>One per line, as in heights.max_m=60</source>
        <translation>Un par ligne, comme heights.max_m=60</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="257" />
        <source>Load the results, styled, as a group</source>
        <translation>Charger les résultats en groupe</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="264" />
        <source>Folder of the results</source>
        <translation>Dossier des résultats</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="265" />
        <source>GeoPackage</source>
        <translation>GeoPackage</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="266" />
        <source>CityJSON</source>
        <translation>CityJSON</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="267" />
        <source>Report</source>
        <translation>Rapport</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="268" />
        <source>Exit code</source>
        <translation>Code de sortie</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="273" />
        <source>Some buildings or photos have no result: see the layer qa_issues, or issues.json in the folder.</source>
        <translation>Certains bâtiments ou photos n'ont pas de résultat : voir la couche qa_issues ou issues.json dans le dossier.</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="286" />
        <source>The settings {} are not there.</source>
        <translation>Les paramètres {} n'existent pas.</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="293" />
        <source>Give the survey as a file or as a folder, one of the two.</source>
        <translation>Indiquez les orientations soit en fichier, soit en dossier.</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="295" />
        <source>The survey {} is not there.</source>
        <translation>Le vol {} n'existe pas.</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="332" />
        <source>The footprints are exported for the program: they are no plain file, or a part of one.</source>
        <translation>Les emprises sont exportées pour le programme : ce n'est pas un simple fichier, ou seulement une partie.</translation>
    </message>
</context>
<context>
    <name>ValidateCity</name>
    <message>
        <location filename="../algorithms/validate.py" line="37" />
        <source>Validate</source>
        <translation>Valider</translation>
    </message>
    <message>
        <location filename="../algorithms/validate.py" line="40" />
        <source>Checks a CityJSON file: its form by the schema, and its solids with the codes of val3dity (ISO 19107).

Each fault of a solid becomes a point at its place, with code, object and surface. CityJSON 1.0, 1.1, 2.0 and CityJSONSeq (.jsonl) of any program will do.</source>
        <translation>Vérifie un fichier CityJSON : sa forme par le schéma, et ses solides avec les codes de val3dity (ISO 19107).

Chaque défaut d'un solide devient un point à sa place, avec code, objet et surface. CityJSON 1.0, 1.1, 2.0 et CityJSONSeq (.jsonl) de tout programme conviennent.</translation>
    </message>
    <message>
        <location filename="../algorithms/validate.py" line="48" />
        <source>CityJSON file</source>
        <translation>Fichier CityJSON</translation>
    </message>
    <message>
        <location filename="../algorithms/validate.py" line="51" />
        <source>Faults</source>
        <translation>Défauts</translation>
    </message>
    <message>
        <location filename="../algorithms/validate.py" line="54" />
        <source>No fault was found</source>
        <translation>Aucun défaut trouvé</translation>
    </message>
    <message>
        <location filename="../algorithms/validate.py" line="55" />
        <source>Number of faults</source>
        <translation>Nombre de défauts</translation>
    </message>
    <message>
        <location filename="../algorithms/validate.py" line="56" />
        <source>Number of geometries</source>
        <translation>Nombre de géométries</translation>
    </message>
    <message>
        <location filename="../algorithms/validate.py" line="74" />
        <source>The file states no CRS: the faults have none either.</source>
        <translation>Le fichier n'indique pas de SCR : les défauts n'en ont pas non plus.</translation>
    </message>
    <message>
        <location filename="../algorithms/validate.py" line="86" />
        <source>{} of {} geometries are valid</source>
        <translation>{} géométries sur {} sont valides</translation>
    </message>
    <message>
        <location filename="../algorithms/validate.py" line="91" />
        <source>… and {} more faults of form</source>
        <translation>… et {} autres défauts de forme</translation>
    </message>
</context>
</TS>
