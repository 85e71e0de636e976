//! Ids from places: the same building has the same id whenever and in whatever tile it is found.
//!
//! `E565123N5932456` is the building whose centre of area lies in the square metre north-east of (565123, 5932456) in
//! the project's CRS. Two buildings with their centres in one square metre (one in the other's courtyard) are told apart
//! as `…`, `…~2`, from the larger to the smaller. New photos may move a centre by centimetres; where that crosses into the
//! next square metre the id changes. Ids of an existing layer, or of an earlier result, are kept by giving it as
//! `cadastre`.

use std::collections::HashMap;

use geo::{Area as _, Centroid as _};
use geo_types::Polygon;

use sizeup_heights::ids::BuildingId;

/// One id per footprint, in their order.
pub(super) fn ids<'a>(footprints: impl Iterator<Item = &'a Polygon<f64>>) -> Vec<BuildingId> {
    let footprints: Vec<&Polygon<f64>> = footprints.collect();
    let places: Vec<String> = footprints.iter().map(|footprint| place(footprint)).collect();
    let mut order: Vec<usize> = (0..footprints.len()).collect();
    order.sort_by(|&a, &b| footprints[b].unsigned_area().total_cmp(&footprints[a].unsigned_area()).then(a.cmp(&b)));
    let mut n_at: HashMap<&str, usize> = HashMap::new();
    let mut ids = vec![BuildingId(String::new()); footprints.len()];
    for i in order {
        let n = n_at.entry(&places[i]).or_default();
        *n += 1;
        ids[i] = BuildingId(if *n == 1 { places[i].clone() } else { format!("{}~{n}", places[i]) });
    }
    ids
}

fn place(footprint: &Polygon<f64>) -> String {
    let centre = footprint.centroid().map_or((0.0, 0.0), |c| (c.x(), c.y()));
    let part =
        |letters: [char; 2], v: f64| format!("{}{}", if v < 0.0 { letters[1] } else { letters[0] }, v.floor().abs());
    format!("{}{}", part(['E', 'W'], centre.0), part(['N', 'S'], centre.1))
}

#[cfg(test)]
mod tests {
    use geo_types::Rect;

    use super::*;

    #[test]
    fn an_id_is_where_the_building_is_whatever_comes_before_it() {
        let house = |x: f64, y: f64, half: f64| Rect::new((x - half, y - half), (x + half, y + half)).to_polygon();
        let (a, b) = (house(565_123.4, 5_932_456.9, 5.0), house(-20.5, 3.0, 4.0));
        let both = ids([&a, &b].into_iter());
        assert_eq!(both[0].0, "E565123N5932456");
        assert_eq!(both[1].0, "W21N3");
        assert_eq!(ids([&b, &a].into_iter())[1], both[0]);
        // One within the other: the larger one is called the same with and without the smaller one.
        let shed = house(565_123.5, 5_932_456.5, 1.0);
        let nested = ids([&shed, &a].into_iter());
        assert_eq!((nested[0].0.as_str(), &nested[1]), ("E565123N5932456~2", &both[0]));
    }
}
