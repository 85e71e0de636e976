<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="de" sourcelanguage="en">
<context>
    <name>ApplyReviews</name>
    <message>
        <location filename="../algorithms/review.py" line="24" />
        <source>Apply reviews</source>
        <translation>Entscheidungen übernehmen</translation>
    </message>
    <message>
        <location filename="../algorithms/review.py" line="27" />
        <source>Writes a result again with the decisions that were made in the review panel.

Buildings that were confirmed or corrected get the status “reviewed” and the reviewed height; buildings that were marked as wrong get the status “unknown”. All files of the folder are written again; heights are not computed again.

The decisions stay in reviews.geojson in the folder, and count for later runs into it too.</source>
        <translation>Schreibt ein Ergebnis mit den Entscheidungen aus der Gebäudeprüfung neu.

Bestätigte und berichtigte Gebäude erhalten den Status „reviewed“ und die geprüfte Höhe; als falsch markierte erhalten den Status „unknown“. Alle Dateien des Ordners werden neu geschrieben; Höhen werden nicht neu berechnet.

Die Entscheidungen bleiben in reviews.geojson im Ordner und gelten auch für spätere Läufe in diesen Ordner.</translation>
    </message>
    <message>
        <location filename="../algorithms/review.py" line="38" />
        <source>Folder of the results</source>
        <translation>Ordner der Ergebnisse</translation>
    </message>
    <message>
        <location filename="../algorithms/review.py" line="41" />
        <source>Load the results, styled, as a group</source>
        <translation>Ergebnisse als Gruppe laden</translation>
    </message>
    <message>
        <location filename="../algorithms/review.py" line="44" />
        <source>GeoPackage</source>
        <translation>GeoPackage</translation>
    </message>
    <message>
        <location filename="../algorithms/review.py" line="45" />
        <source>Exit code</source>
        <translation>Rückgabewert</translation>
    </message>
    <message>
        <location filename="../algorithms/review.py" line="52" />
        <source>{} is not there.</source>
        <translation>{} ist nicht vorhanden.</translation>
    </message>
    <message>
        <location filename="../algorithms/review.py" line="64" />
        <source>Some buildings have no height: see the layer qa_issues.</source>
        <translation>Einige Gebäude haben keine Höhe: siehe Layer qa_issues.</translation>
    </message>
</context>
<context>
    <name>CityFromFolder</name>
    <message>
        <location filename="../algorithms/city.py" line="34" />
        <source>City from a folder of photos</source>
        <translation>Stadt aus einem Fotoordner</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="37" />
        <source>Makes a 3D city from a folder of photos and building footprints.

Choose the folder of the photos, the footprints, and a folder for the results. The poses may be in the photos (DJI and other drones) or in files beside them: ODM, Metashape, Pix4D, COLMAP and others. The program finds the poses, the CRS, the heights and the ground. The log lists what it found, and what you should know of it.

A terrain model (DTM) makes heights better. Put it into the folder of the photos, or choose it here. Without one, the program finds the ground in the photos.

If something is missing, nothing is computed, and the message says what to add. “Only look at the folder” stops before anything is computed.

The settings are written to input/sizeup.toml in the folder of the results. “Inspect survey” and “Estimate heights” can start from that file.</source>
        <translation>Erstellt eine 3D-Stadt aus einem Ordner mit Fotos und Gebäudegrundrissen.

Wählen Sie den Ordner der Fotos, die Grundrisse und einen Ordner für die Ergebnisse. Die Orientierungen können in den Fotos stehen (DJI und andere Drohnen) oder in Dateien daneben: ODM, Metashape, Pix4D, COLMAP und andere. Das Programm findet Orientierungen, KBS, Höhen und Gelände. Das Protokoll nennt, was es gefunden hat und was Sie darüber wissen sollten.

Ein Geländemodell (DGM) macht die Höhen genauer. Legen Sie es in den Ordner der Fotos oder wählen Sie es hier. Ohne Geländemodell findet das Programm das Gelände in den Fotos.

Fehlt etwas, wird nichts berechnet, und die Meldung nennt, was hinzuzufügen ist. „Ordner nur ansehen“ endet, bevor etwas berechnet wird.

Die Einstellungen stehen in input/sizeup.toml im Ordner der Ergebnisse. „Befliegung prüfen“ und „Höhen schätzen“ können mit dieser Datei beginnen.</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="55" />
        <source>Folder of the photos</source>
        <translation>Ordner der Fotos</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="58" />
        <source>Building footprints</source>
        <translation>Gebäudegrundrisse</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="58" />
        <source>If empty: those in the folder</source>
        <translation>Wenn leer: die im Ordner</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="64" />
        <source>Field of the buildings' ids</source>
        <translation>Feld der Gebäudekennungen</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="64" />
        <source>If empty: the program chooses</source>
        <translation>Wenn leer: das Programm wählt</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="70" />
        <source>Only look at the folder</source>
        <translation>Ordner nur ansehen</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="70" />
        <source>Computes nothing</source>
        <translation>Berechnet nichts</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="74" />
        <source>Terrain model (DTM)</source>
        <translation>Geländemodell (DGM)</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="75" />
        <source>Height of the ground, metres</source>
        <translation>Höhe des Geländes, Meter</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="78" />
        <source>CRS of the results</source>
        <translation>KBS der Ergebnisse</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="78" />
        <source>Projected, in metres</source>
        <translation>Projiziert, in Metern</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="81" />
        <source>Offset of the poses: x, y, z</source>
        <translation>Versatz der Orientierungen</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="81" />
        <source>Metres, which the program that wrote the poses took off them</source>
        <translation>Meter, die das schreibende Programm von den Orientierungen abgezogen hat</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="86" />
        <source>Settings</source>
        <translation>Einstellungen</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="93" />
        <source>The folder of the photos {} is not there.</source>
        <translation>Der Ordner der Fotos {} ist nicht vorhanden.</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="116" />
        <source>Give a terrain model or a height of the ground, one of the two.</source>
        <translation>Geben Sie entweder ein Geländemodell oder eine Geländehöhe an.</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="139" />
        <source>Nothing is missing. The settings are in {}.</source>
        <translation>Es fehlt nichts. Die Einstellungen sind in {}.</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="168" />
        <source>Photos</source>
        <translation>Fotos</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="168" />
        <source>{} photos, {} with a usable pose: {} straight down, {} oblique</source>
        <translation>{} Fotos, {} mit brauchbarer Orientierung: {} senkrecht, {} schräg</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="170" />
        <source>Poses</source>
        <translation>Orientierungen</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="171" />
        <source>CRS</source>
        <translation>KBS</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="172" />
        <source>Heights</source>
        <translation>Höhen</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="173" />
        <source>Footprints</source>
        <translation>Grundrisse</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="174" />
        <source>Ground</source>
        <translation>Gelände</translation>
    </message>
    <message>
        <location filename="../algorithms/city.py" line="180" />
        <source>Missing: {}.</source>
        <translation>Es fehlt: {}.</translation>
    </message>
</context>
<context>
    <name>CompareResults</name>
    <message>
        <location filename="../algorithms/changes.py" line="26" />
        <source>What changed</source>
        <translation>Was sich geändert hat</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="29" />
        <source>Tells what changed between two results: new, gone, raised, lowered, footprint changed, same, or unsure.

Buildings are matched by place, so their ids need not be the same: the new ones are kept, and the old ones stand beside them. A difference counts where both standard deviations do not explain it; where they are too wide to tell, the building is unsure. What is common to all buildings (a flight whose poses are a little off) is taken off and told.

Each result is the city.gpkg of a run, or its CityJSON. The layer has a row per building, with the reason in words.</source>
        <translation>Vergleicht zwei Ergebnisse: neu, verschwunden, erhöht, erniedrigt, Grundriss geändert, gleich oder unsicher.

Gebäude werden nach ihrer Lage zugeordnet, ihre Kennungen dürfen sich also unterscheiden: Die neuen werden übernommen, die alten stehen daneben. Ein Unterschied zählt, wenn ihn die beiden Standardabweichungen nicht erklären; sind sie dafür zu groß, ist das Gebäude unsicher. Was allen Gebäuden gemeinsam ist (eine Befliegung mit leicht versetzten Orientierungen), wird abgezogen und genannt.

Jedes Ergebnis ist die city.gpkg eines Laufs oder sein CityJSON. Der Layer hat eine Zeile je Gebäude mit der Begründung in Worten.</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="41" />
        <source>Earlier result</source>
        <translation>Früheres Ergebnis</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="42" />
        <source>Later result</source>
        <translation>Späteres Ergebnis</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="43" />
        <source>Least difference, metres</source>
        <translation>Kleinster Unterschied, Meter</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="47" />
        <source>Load the layer, styled</source>
        <translation>Layer mit Stil laden</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="50" />
        <source>Earlier sigma, metres</source>
        <translation>Sigma früher, Meter</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="50" />
        <source>Later sigma, metres</source>
        <translation>Sigma später, Meter</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="51" />
        <source>Standard deviation of heights whose file states none</source>
        <translation>Standardabweichung von Höhen, deren Datei keine nennt</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="57" />
        <source>Compare heights above ground only</source>
        <translation>Nur Höhen über Grund vergleichen</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="57" />
        <source>Levels of roofs are not compared</source>
        <translation>Absolute Dachhöhen werden nicht verglichen</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="61" />
        <source>Keep a common difference</source>
        <translation>Gemeinsamen Unterschied behalten</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="61" />
        <source>What all buildings have in common counts as change, too</source>
        <translation>Was allen Gebäuden gemeinsam ist, zählt auch als Änderung</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="65" />
        <source>Folder of the comparison</source>
        <translation>Ordner des Vergleichs</translation>
    </message>
    <message>
        <location filename="../algorithms/changes.py" line="66" />
        <source>Number of buildings that have changed</source>
        <translation>Anzahl der geänderten Gebäude</translation>
    </message>
</context>
<context>
    <name>EstimateHeights</name>
    <message>
        <location filename="../algorithms/heights.py" line="21" />
        <source>Estimate heights</source>
        <translation>Höhen schätzen</translation>
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
        <translation>Findet in Schrägluftbildern eine Höhe je Gebäudegrundriss und schreibt eine LOD1-Stadt: GeoPackage, CityJSON, Bericht.

Nötig sind Fotos mit bekannten Orientierungen, Gebäudegrundrisse und das Gelände: ein Geländemodell (kein Oberflächenmodell) oder eine Höhe, wo es eben ist. Grundrisse dürfen in jedem KBS sein; Ergebnisse sind im hier gewählten KBS, projiziert und in Metern. Von einem Layer mit Filter oder Auswahl wird das Gefilterte oder Ausgewählte verwendet.

Die Tiefe der Fotos stammt aus:
- „automatisch“: einem Netz, wenn eines genannt und vorhanden ist, sonst Stereo
- „Stereo“: dem Abgleich der Fotos untereinander
- „Dateien“: einer Tiefenkarte je Foto, priors/{stem}.npy, aus einem beliebigen Netz
- „ein Netz“: einer ONNX-Datei oder dem Namen eines Netzes, das `sizeup model get` bereitgestellt hat

Die Layer werden mit Stil geladen: Gebäude nach Höhe, zweifelhafte schraffiert, Hinweise als Punkte, Kameras. report.html im Ordner zeigt Fotos und Belege; zweifelhafte Gebäude prüfen Sie mit Erweiterungen &gt; sizeup &gt; Gebäude prüfen. Entscheidungen im Ordner (reviews.geojson) gelten beim nächsten Lauf.

Nach einem Abbruch wird nichts geladen, und jede Datei im Ordner ist vollständig, aus diesem Lauf oder dem vorigen.</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="47" />
        <source>Building footprints</source>
        <translation>Gebäudegrundrisse</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="49" />
        <source>Depth comes from</source>
        <translation>Tiefe stammt aus</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="49" />
        <source>automatic</source>
        <translation>automatisch</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="49" />
        <source>stereo</source>
        <translation>Stereo</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="49" />
        <source>files</source>
        <translation>Dateien</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="49" />
        <source>a network</source>
        <translation>ein Netz</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="53" />
        <source>Files: path with {stem}</source>
        <translation>Dateien: Pfad mit {stem}</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="53" />
        <source>{stem} stands for the name of the photo, as in priors/{stem}.npy</source>
        <translation>{stem} steht für den Namen des Fotos, wie in priors/{stem}.npy</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="57" />
        <source>Files: numbers are</source>
        <translation>Dateien: Zahlen sind</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="57" />
        <source>depth (higher is farther)</source>
        <translation>Tiefe (größer ist ferner)</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="57" />
        <source>inverse depth (higher is nearer)</source>
        <translation>inverse Tiefe (größer ist näher)</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="61" />
        <source>Network: ONNX file or name</source>
        <translation>Netz: ONNX-Datei oder Name</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="64" />
        <source>Network: profile</source>
        <translation>Netz: Profil</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="64" />
        <source>If empty: by the name of the network</source>
        <translation>Wenn leer: nach dem Namen des Netzes</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="70" />
        <source>Vertical reference</source>
        <translation>Höhenbezug</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="70" />
        <source>What heights count from, in words: DHHN2016, NAP, …</source>
        <translation>Worauf sich Höhen beziehen, in Worten: DHHN2016, NAP, …</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="90" />
        <source>Choose a layer of building footprints.</source>
        <translation>Wählen Sie einen Layer mit Gebäudegrundrissen.</translation>
    </message>
    <message>
        <location filename="../algorithms/heights.py" line="92" />
        <source>Give a terrain model, or one height of the ground. “City from a folder of photos” finds the ground itself.</source>
        <translation>Geben Sie ein Geländemodell oder eine Geländehöhe an. „Stadt aus einem Fotoordner“ findet das Gelände selbst.</translation>
    </message>
</context>
<context>
    <name>ExportCity</name>
    <message>
        <location filename="../algorithms/export.py" line="34" />
        <source>Export</source>
        <translation>Exportieren</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="37" />
        <source>Writes a city in another format: CityJSON, CityJSONSeq, GeoPackage, FlatGeobuf, FlatCityBuf, GeoJSON, CityGML, OBJ, STL, DXF, KML, CSV, 3D Tiles.

The input is a result of sizeup, or anybody's CityJSON with heights. 3D Tiles are a folder; they need to know how high the geoid is above the ellipsoid there, if the CRS does not say what heights count from.

Cameras and issues are only in the files of a run: an export has the buildings with all their attributes.</source>
        <translation>Schreibt eine Stadt in einem anderen Format: CityJSON, CityJSONSeq, GeoPackage, FlatGeobuf, FlatCityBuf, GeoJSON, CityGML, OBJ, STL, DXF, KML, CSV, 3D Tiles.

Die Eingabe ist ein Ergebnis von sizeup oder ein beliebiges CityJSON mit Höhen. 3D Tiles sind ein Ordner; dafür muss bekannt sein, wie hoch das Geoid dort über dem Ellipsoid liegt, wenn das KBS den Höhenbezug nicht nennt.

Kameras und Hinweise sind nur in den Dateien eines Laufs: Ein Export hat die Gebäude mit allen Attributen.</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="48" />
        <source>City</source>
        <translation>Stadt</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="51" />
        <source>Format</source>
        <translation>Format</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="51" />
        <source>OBJ (modelling)</source>
        <translation>OBJ (Modellierung)</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="51" />
        <source>STL (printers)</source>
        <translation>STL (3D-Druck)</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="51" />
        <source>DXF (CAD)</source>
        <translation>DXF (CAD)</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="51" />
        <source>KML (globes)</source>
        <translation>KML (Globen)</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="51" />
        <source>CSV (tables)</source>
        <translation>CSV (Tabellen)</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="51" />
        <source>3D Tiles (a folder)</source>
        <translation>3D Tiles (ein Ordner)</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="59" />
        <source>CRS, if the city states none</source>
        <translation>KBS, wenn in der Stadt keines</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="60" />
        <source>CityJSON: names of attributes</source>
        <translation>CityJSON: Namen der Attribute</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="63" />
        <source>3D Tiles: geoid height, metres</source>
        <translation>3D Tiles: Geoidhöhe, Meter</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="63" />
        <source>Of the geoid, or the national zero, above the ellipsoid</source>
        <translation>Des Geoids oder des Landeshöhennulls über dem Ellipsoid</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="67" />
        <source>Load the file</source>
        <translation>Datei laden</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="68" />
        <source>File, or folder of 3D Tiles</source>
        <translation>Datei, oder Ordner der 3D Tiles</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="78" />
        <source>{} is open in this project: choose another name.</source>
        <translation>{} ist in diesem Projekt geöffnet: Wählen Sie einen anderen Namen.</translation>
    </message>
    <message>
        <location filename="../algorithms/export.py" line="108" />
        <source>QGIS reads CityJSON and 3D Tiles through other plugins or newer versions.</source>
        <translation>QGIS liest CityJSON und 3D Tiles mit anderen Erweiterungen oder neueren Versionen.</translation>
    </message>
</context>
<context>
    <name>FindFootprints</name>
    <message>
        <location filename="../algorithms/footprints.py" line="27" />
        <source>Footprints from photos</source>
        <translation>Grundrisse aus Fotos</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="30" />
        <source>Finds building footprints in the nadir photos, lays them on the ground and makes one footprint per building.

It takes masks that another tool has made (one image per photo, or one COCO file), or runs a segmentation network (ONNX). In the masks' path {stem} stands for the photo's name without extension: masks/{stem}.png

Kinds of masks: “instance”, every building has its own number; “semantic”, building or not; “probability”; “coco”, one JSON file. Row houses stay apart only where masks tell them apart.

With a cadastre, ids and attributes of known buildings are kept, and what is new or gone is marked.

The result is footprints.gpkg, styled by how sure each footprint is, and pictures of the photos with the footprints drawn over them.</source>
        <translation>Findet Gebäudegrundrisse in den Senkrechtaufnahmen, legt sie auf das Gelände und bildet einen Grundriss je Gebäude.

Verwendet werden Masken eines anderen Programms (ein Bild je Foto oder eine COCO-Datei) oder ein Segmentierungsnetz (ONNX). Im Pfad der Masken steht {stem} für den Namen des Fotos ohne Endung: masks/{stem}.png

Arten von Masken: „instance“, jedes Gebäude hat eine eigene Nummer; „semantic“, Gebäude oder nicht; „probability“; „coco“, eine JSON-Datei. Reihenhäuser bleiben nur getrennt, wenn die Masken sie trennen.

Mit einem Kataster bleiben Kennungen und Attribute bekannter Gebäude erhalten, und Neues und Verschwundenes wird markiert.

Das Ergebnis ist footprints.gpkg, gestaltet nach der Sicherheit jedes Grundrisses, dazu Bilder der Fotos mit eingezeichneten Grundrissen.</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="48" />
        <source>Footprints come from</source>
        <translation>Grundrisse stammen aus</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="48" />
        <source>masks of the nadir photos</source>
        <translation>Masken der Senkrechtaufnahmen</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="48" />
        <source>a segmentation network</source>
        <translation>einem Segmentierungsnetz</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="52" />
        <source>Masks: path with {stem}</source>
        <translation>Masken: Pfad mit {stem}</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="52" />
        <source>{stem} stands for the name of the photo, as in masks/{stem}.png</source>
        <translation>{stem} steht für den Namen des Fotos, wie in masks/{stem}.png</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="56" />
        <source>Masks: kind</source>
        <translation>Masken: Art</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="59" />
        <source>Network: ONNX file</source>
        <translation>Netz: ONNX-Datei</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="62" />
        <source>Network: profile</source>
        <translation>Netz: Profil</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="65" />
        <source>Cadastre whose ids are kept</source>
        <translation>Kataster mit den Kennungen</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="68" />
        <source>Folder of the results</source>
        <translation>Ordner der Ergebnisse</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="69" />
        <source>GeoPackage of the footprints</source>
        <translation>GeoPackage der Grundrisse</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="70" />
        <source>Exit code</source>
        <translation>Rückgabewert</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="79" />
        <source>Say where the masks are, as in masks/{stem}.png.</source>
        <translation>Geben Sie an, wo die Masken sind, wie in masks/{stem}.png.</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="81" />
        <source>Name the network's ONNX file.</source>
        <translation>Geben Sie die ONNX-Datei des Netzes an.</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="83" />
        <source>Give a terrain model, or one height of the ground.</source>
        <translation>Geben Sie ein Geländemodell oder eine Geländehöhe an.</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="105" />
        <source>Some photos could not be used: see issues.json in the folder.</source>
        <translation>Einige Fotos waren nicht brauchbar: siehe issues.json im Ordner.</translation>
    </message>
    <message>
        <location filename="../algorithms/footprints.py" line="112" />
        <source>Cannot load {}</source>
        <translation>{} kann nicht geladen werden</translation>
    </message>
</context>
<context>
    <name>Footprints</name>
    <message>
        <location filename="../layers.py" line="43" />
        <source>The layer “{}” has unsaved edits: save or discard them first.</source>
        <translation>Der Layer „{}“ hat ungespeicherte Änderungen: Speichern oder verwerfen Sie diese zuerst.</translation>
    </message>
    <message>
        <location filename="../layers.py" line="47" />
        <source>The layer “{}” has no CRS: set it in Layer Properties &gt; Source.</source>
        <translation>Der Layer „{}“ hat kein KBS: Setzen Sie es in Layereigenschaften &gt; Quelle.</translation>
    </message>
    <message>
        <location filename="../layers.py" line="81" />
        <source>Cannot write {}: {}</source>
        <translation>{} kann nicht geschrieben werden: {}</translation>
    </message>
    <message>
        <location filename="../layers.py" line="85" />
        <source>The layer “{}” has no features to read.</source>
        <translation>Der Layer „{}“ hat keine Objekte.</translation>
    </message>
</context>
<context>
    <name>InspectSurvey</name>
    <message>
        <location filename="../algorithms/inspect.py" line="21" />
        <source>Inspect survey</source>
        <translation>Befliegung prüfen</translation>
    </message>
    <message>
        <location filename="../algorithms/inspect.py" line="24" />
        <source>Says whether the photos' poses look right, before anything is computed from them.

Loads three layers: where the cameras are, where they look, and what part of the ground each photo shows. If these lie beside your footprints, the CRS, the offset or the reading of the angles is wrong; the report says which other reading looks better.

Give the ground (a terrain model or one height) and the footprints too: both tell more of the poses.

A table of poses needs to say what its angles mean, under “Further settings”: survey.csv.angles=opk and so on.</source>
        <translation>Prüft, ob die Orientierungen der Fotos richtig aussehen, bevor daraus etwas berechnet wird.

Lädt drei Layer: Standorte der Kameras, ihre Blickrichtungen und den Teil des Geländes, den jedes Foto zeigt. Liegen diese neben Ihren Grundrissen, ist das KBS, der Versatz oder die Deutung der Winkel falsch; der Bericht nennt die Deutung, die besser passt.

Geben Sie auch das Gelände (ein Geländemodell oder eine Höhe) und die Grundrisse an: Beide sagen mehr über die Orientierungen.

Zu einer Tabelle von Orientierungen gehört unter „Weitere Einstellungen“, was ihre Winkel bedeuten: survey.csv.angles=opk und so weiter.</translation>
    </message>
    <message>
        <location filename="../algorithms/inspect.py" line="40" />
        <source>Building footprints</source>
        <translation>Gebäudegrundrisse</translation>
    </message>
    <message>
        <location filename="../algorithms/inspect.py" line="43" />
        <source>Folder of the report</source>
        <translation>Ordner des Berichts</translation>
    </message>
    <message>
        <location filename="../algorithms/inspect.py" line="44" />
        <source>The poses look right</source>
        <translation>Die Orientierungen sehen richtig aus</translation>
    </message>
    <message>
        <location filename="../algorithms/inspect.py" line="46" />
        <source>Report</source>
        <translation>Bericht</translation>
    </message>
    <message>
        <location filename="../algorithms/inspect.py" line="47" />
        <source>Map of the survey</source>
        <translation>Karte der Befliegung</translation>
    </message>
    <message>
        <location filename="../algorithms/inspect.py" line="48" />
        <source>GeoPackage of cameras and image footprints</source>
        <translation>GeoPackage der Kameras und Bildflächen</translation>
    </message>
    <message>
        <location filename="../algorithms/inspect.py" line="75" />
        <source>The poses look wrong: see the report above.</source>
        <translation>Die Orientierungen sehen falsch aus: siehe Bericht oben.</translation>
    </message>
    <message>
        <location filename="../algorithms/inspect.py" line="89" />
        <source>Cannot load {}</source>
        <translation>{} kann nicht geladen werden</translation>
    </message>
</context>
<context>
    <name>PhotoView</name>
    <message>
        <location filename="../review/photo.py" line="99" />
        <source>No photo</source>
        <translation>Kein Foto</translation>
    </message>
</context>
<context>
    <name>ReviewDock</name>
    <message>
        <location filename="../review/dock.py" line="74" />
        <source>The result: buildings of a city.gpkg in the project</source>
        <translation>Das Ergebnis: Gebäude einer city.gpkg im Projekt</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="77" />
        <source>doubtful and without a height</source>
        <translation>zweifelhafte und ohne Höhe</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="77" />
        <source>the same, without a decision yet</source>
        <translation>dieselben, noch ohne Entscheidung</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="77" />
        <source>all buildings</source>
        <translation>alle Gebäude</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="82" />
        <source>Result</source>
        <translation>Ergebnis</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="83" />
        <source>Show</source>
        <translation>Zeigen</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="104" />
        <source>Apply to the result…</source>
        <translation>Ins Ergebnis übernehmen…</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="105" />
        <source>Writes the result again with the decisions; heights are not computed again</source>
        <translation>Schreibt das Ergebnis mit den Entscheidungen neu; Höhen werden nicht neu berechnet</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="117" />
        <source>Building before (Page Up)</source>
        <translation>Voriges Gebäude (Bild auf)</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="118" />
        <source>Next building (Page Down)</source>
        <translation>Nächstes Gebäude (Bild ab)</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="130" />
        <source>Photo before</source>
        <translation>Voriges Foto</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="131" />
        <source>Next photo</source>
        <translation>Nächstes Foto</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="145" />
        <source>Height above the ground; the block in the photo follows</source>
        <translation>Höhe über Grund; der Block im Foto folgt</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="148" />
        <source>why, if you like</source>
        <translation>Grund, wenn Sie mögen</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="151" />
        <source>Height</source>
        <translation>Höhe</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="152" />
        <source>Note</source>
        <translation>Notiz</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="153" />
        <source>By</source>
        <translation>Von</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="154" />
        <source>Confirm</source>
        <translation>Bestätigen</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="155" />
        <source>The height that was found is right</source>
        <translation>Die gefundene Höhe stimmt</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="157" />
        <source>Correct height</source>
        <translation>Berichtigen</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="158" />
        <source>The height above is right</source>
        <translation>Die Höhe oben stimmt</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="160" />
        <source>Wrong</source>
        <translation>Falsch</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="161" />
        <source>The height is wrong, and the right one is not known</source>
        <translation>Die Höhe ist falsch, die richtige ist nicht bekannt</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="163" />
        <source>Undo</source>
        <translation>Rückgängig</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="164" />
        <source>Takes the decision about this building back</source>
        <translation>Nimmt die Entscheidung über dieses Gebäude zurück</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="226" />
        <source>measured</source>
        <translation>gemessen</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="226" />
        <source>given</source>
        <translation>vorgegeben</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="226" />
        <source>doubtful</source>
        <translation>zweifelhaft</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="227" />
        <source>from a fallback</source>
        <translation>aus einem Ersatzwert</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="278" />
        <source>height not known</source>
        <translation>Höhe nicht bekannt</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="228" />
        <source>footprint refused</source>
        <translation>Grundriss unbrauchbar</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="228" />
        <source>reviewed</source>
        <translation>geprüft</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="233" />
        <source>wrong</source>
        <translation>falsch</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="234" />
        <source>confirmed</source>
        <translation>bestätigt</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="234" />
        <source>corrected</source>
        <translation>berichtigt</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="252" />
        <source>{} of {}</source>
        <translation>{} von {}</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="252" />
        <source>none</source>
        <translation>keine</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="268" />
        <source>Load a result first: its layer “buildings”.</source>
        <translation>Laden Sie zuerst ein Ergebnis: seinen Layer „buildings“.</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="268" />
        <source>Nothing to look at: every building is measured, or has a decision.</source>
        <translation>Nichts zu prüfen: Jedes Gebäude ist gemessen oder entschieden.</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="298" />
        <source>No photo of this building is at hand: the survey names no photo files, or they are not where they were.</source>
        <translation>Zu diesem Gebäude ist kein Foto vorhanden: Die Befliegung nennt keine Fotodateien, oder sie sind nicht mehr am alten Ort.</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="302" />
        <source>photo {} of {}</source>
        <translation>Foto {} von {}</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="352" />
        <source>The decision cannot be kept: {}</source>
        <translation>Die Entscheidung kann nicht gespeichert werden: {}</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="354" />
        <source>{} decisions in {}</source>
        <translation>{} Entscheidungen in {}</translation>
    </message>
</context>
<context>
    <name>SizeupAlgorithm</name>
    <message>
        <location filename="../algorithms/base.py" line="129" />
        <source>Stopped. Nothing is loaded; every file is whole, or absent.</source>
        <translation>Abgebrochen. Nichts ist geladen; jede Datei ist vollständig oder fehlt.</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="131" />
        <source>The files in {} are of two runs: run it again.</source>
        <translation>Die Dateien in {} stammen aus zwei Läufen: Starten Sie erneut.</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="158" />
        <source>The program's answer cannot be read: {}</source>
        <translation>Die Antwort des Programms ist nicht lesbar: {}</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="163" />
        <source>Reading the survey</source>
        <translation>Befliegung lesen</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="163" />
        <source>Laying footprints on the ground</source>
        <translation>Grundrisse auf das Gelände legen</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="164" />
        <source>Finding heights</source>
        <translation>Höhen finden</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="164" />
        <source>Writing the results</source>
        <translation>Ergebnisse schreiben</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="165" />
        <source>Looking for the ground in the photos</source>
        <translation>Gelände in den Fotos suchen</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="165" />
        <source>Looking at the photos</source>
        <translation>Fotos ansehen</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="166" />
        <source>Aligning the poses with the photos</source>
        <translation>Orientierungen an die Fotos anpassen</translation>
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
        <translation>{} (noch etwa {})</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="179" />
        <source>Cannot load {}</source>
        <translation>{} kann nicht geladen werden</translation>
    </message>
</context>
<context>
    <name>SizeupPlugin</name>
    <message>
        <location filename="../plugin.py" line="35" />
        <source>City from a folder of photos…</source>
        <translation>Stadt aus einem Fotoordner…</translation>
    </message>
    <message>
        <location filename="../plugin.py" line="38" />
        <source>Estimate heights…</source>
        <translation>Höhen schätzen…</translation>
    </message>
    <message>
        <location filename="../plugin.py" line="39" />
        <source>Review buildings</source>
        <translation>Gebäude prüfen</translation>
    </message>
</context>
<context>
    <name>Speaks</name>
    <message>
        <location filename="../layers.py" line="120" />
        <source>The terrain model “{}” is not a file: save it with Layer &gt; Save As… as a GeoTIFF first, and choose that.</source>
        <translation>Das Geländemodell „{}“ ist keine Datei: Speichern Sie es zuerst mit Layer &gt; Speichern als… als GeoTIFF und wählen Sie dieses.</translation>
    </message>
    <message>
        <location filename="../layers.py" line="130" />
        <source>No CRS: choose a projected one in metres, such as EPSG:25832.</source>
        <translation>Kein KBS: Wählen Sie ein projiziertes in Metern, etwa EPSG:25832.</translation>
    </message>
    <message>
        <location filename="../layers.py" line="132" />
        <source>{} is geographic: its unit is a degree. Choose a projected CRS in metres, such as the UTM zone of the place; the layers themselves may stay as they are.</source>
        <translation>{} ist geographisch: Seine Einheit ist Grad. Wählen Sie ein projiziertes KBS in Metern, etwa die UTM-Zone des Ortes; die Layer selbst können bleiben, wie sie sind.</translation>
    </message>
    <message>
        <location filename="../layers.py" line="140" />
        <source>The unit of {} is {}: choose a projected CRS in metres.</source>
        <translation>Die Einheit von {} ist {}: Wählen Sie ein projiziertes KBS in Metern.</translation>
    </message>
    <message>
        <location filename="../results.py" line="55" />
        <source>The layer “{}” of {} is being edited: end that first, the folder's files are to be replaced.</source>
        <translation>Der Layer „{}“ in {} wird gerade bearbeitet: Beenden Sie das zuerst, die Dateien des Ordners werden ersetzt.</translation>
    </message>
    <message>
        <location filename="../review/dock.py" line="51" />
        <source>Review buildings</source>
        <translation>Gebäude prüfen</translation>
    </message>
    <message>
        <location filename="../settings.py" line="14" />
        <source>sizeup program (empty: the one on the path)</source>
        <translation>sizeup-Programm (leer: das im Suchpfad)</translation>
    </message>
</context>
<context>
    <name>SurveyAlgorithm</name>
    <message>
        <location filename="../algorithms/base.py" line="198" />
        <source>Settings</source>
        <translation>Einstellungen</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="198" />
        <source>Written by “City from a folder of photos”. Then nothing else is needed.</source>
        <translation>Von „Stadt aus einem Fotoordner“ geschrieben. Dann ist nichts anderes nötig.</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="205" />
        <source>Poses: folder</source>
        <translation>Orientierungen: Ordner</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="205" />
        <source>The folder of a model (COLMAP, OpenSfM), or of photos with poses</source>
        <translation>Der Ordner eines Modells (COLMAP, OpenSfM) oder von Fotos mit Orientierung</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="211" />
        <source>… or poses: file</source>
        <translation>… oder Datei</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="211" />
        <source>XML, CSV, JSON and others</source>
        <translation>XML, CSV, JSON und andere</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="215" />
        <source>Folder of the photos</source>
        <translation>Ordner der Fotos</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="218" />
        <source>CRS of the results</source>
        <translation>KBS der Ergebnisse</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="218" />
        <source>Projected, in metres</source>
        <translation>Projiziert, in Metern</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="224" />
        <source>Terrain model (DTM)</source>
        <translation>Geländemodell (DGM)</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="225" />
        <source>… or one ground height, metres</source>
        <translation>… oder eine Geländehöhe, m</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="235" />
        <source>Field of the buildings' ids</source>
        <translation>Feld der Gebäudekennungen</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="241" />
        <source>CRS of the poses, if another</source>
        <translation>KBS der Orientierungen</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="242" />
        <source>Offset of the poses: x, y, z</source>
        <translation>Versatz der Orientierungen</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="242" />
        <source>Metres, added to the poses</source>
        <translation>Meter, die zu den Orientierungen addiert werden</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="250" />
        <source>Further settings</source>
        <translation>Weitere Einstellungen</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="250" />
        <source>One per line, as in heights.max_m=60</source>
        <translation>Eine je Zeile, wie heights.max_m=60</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="257" />
        <source>Load the results, styled, as a group</source>
        <translation>Ergebnisse als Gruppe laden</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="264" />
        <source>Folder of the results</source>
        <translation>Ordner der Ergebnisse</translation>
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
        <translation>Bericht</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="268" />
        <source>Exit code</source>
        <translation>Rückgabewert</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="273" />
        <source>Some buildings or photos have no result: see the layer qa_issues, or issues.json in the folder.</source>
        <translation>Einige Gebäude oder Fotos haben kein Ergebnis: siehe Layer qa_issues oder issues.json im Ordner.</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="286" />
        <source>The settings {} are not there.</source>
        <translation>Die Einstellungen {} sind nicht vorhanden.</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="293" />
        <source>Give the survey as a file or as a folder, one of the two.</source>
        <translation>Geben Sie die Orientierungen entweder als Datei oder als Ordner an.</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="295" />
        <source>The survey {} is not there.</source>
        <translation>Die Befliegung {} ist nicht vorhanden.</translation>
    </message>
    <message>
        <location filename="../algorithms/base.py" line="332" />
        <source>The footprints are exported for the program: they are no plain file, or a part of one.</source>
        <translation>Die Grundrisse werden für das Programm exportiert: Sie sind keine einfache Datei oder nur ein Teil davon.</translation>
    </message>
</context>
<context>
    <name>ValidateCity</name>
    <message>
        <location filename="../algorithms/validate.py" line="37" />
        <source>Validate</source>
        <translation>Prüfen</translation>
    </message>
    <message>
        <location filename="../algorithms/validate.py" line="40" />
        <source>Checks a CityJSON file: its form by the schema, and its solids with the codes of val3dity (ISO 19107).

Each fault of a solid becomes a point at its place, with code, object and surface. CityJSON 1.0, 1.1, 2.0 and CityJSONSeq (.jsonl) of any program will do.</source>
        <translation>Prüft eine CityJSON-Datei: ihre Form nach dem Schema und ihre Volumenkörper mit den Codes von val3dity (ISO 19107).

Jeder Fehler eines Körpers wird zu einem Punkt an seinem Ort, mit Code, Objekt und Fläche. CityJSON 1.0, 1.1, 2.0 und CityJSONSeq (.jsonl) beliebiger Programme sind möglich.</translation>
    </message>
    <message>
        <location filename="../algorithms/validate.py" line="48" />
        <source>CityJSON file</source>
        <translation>CityJSON-Datei</translation>
    </message>
    <message>
        <location filename="../algorithms/validate.py" line="51" />
        <source>Faults</source>
        <translation>Fehler</translation>
    </message>
    <message>
        <location filename="../algorithms/validate.py" line="54" />
        <source>No fault was found</source>
        <translation>Kein Fehler gefunden</translation>
    </message>
    <message>
        <location filename="../algorithms/validate.py" line="55" />
        <source>Number of faults</source>
        <translation>Anzahl der Fehler</translation>
    </message>
    <message>
        <location filename="../algorithms/validate.py" line="56" />
        <source>Number of geometries</source>
        <translation>Anzahl der Geometrien</translation>
    </message>
    <message>
        <location filename="../algorithms/validate.py" line="74" />
        <source>The file states no CRS: the faults have none either.</source>
        <translation>Die Datei nennt kein KBS: Die Fehler haben auch keines.</translation>
    </message>
    <message>
        <location filename="../algorithms/validate.py" line="86" />
        <source>{} of {} geometries are valid</source>
        <translation>{} von {} Geometrien sind gültig</translation>
    </message>
    <message>
        <location filename="../algorithms/validate.py" line="91" />
        <source>… and {} more faults of form</source>
        <translation>… und {} weitere Formfehler</translation>
    </message>
</context>
</TS>
