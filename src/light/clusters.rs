//! Columns grouped into a few clusters, over which tracing sums what is too large to keep for every column.

use super::{Light, LightBasis, LightKind};

/// Up to this many columns are clusters of their own. Tuned: decision 54.
const SINGLE_COLUMNS: usize = 80;
/// What [`SINGLE_COLUMNS`] was for the first planes of the format, and most clusters of a basis with more columns.
const FIRST_SINGLE_COLUMNS: usize = 32;
/// Up to this many lights that are known by their images alone are clusters of their own: there is no place to group them by.
const SINGLE_IMAGES: usize = 256;
/// Clusters of a basis with more columns, at most.
const MAX_CLUSTERS: usize = 24;
/// Clusters of one light, at most.
const MAX_CLUSTERS_OF_LIGHT: usize = 16;
/// Part of the power of its light, in the scene's own lighting, from which on a texel is a cluster of its own.
const BRIGHT_SHARE: f64 = 1.0 / 32.0;
/// Steps of Lloyd's iteration; a few dozen lights settle sooner.
const ITERATIONS: usize = 32;

/// A partition of the columns of a basis: `S`, the 0/1 matrix columns × clusters. It follows from the basis alone.
///
/// At most 80 columns are each a cluster, and at most 256 lights that are known by their images alone. Of more, a light with texels is cut into nearly square rectangles of its grid,
/// larger lights into more of them; single lamps are grouped by place, suns by direction. The brightest texels of the scene's own
/// lighting, such as the sun in an environment's map, are then clusters of their own, as far as there are clusters left.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Clusters {
    of_column: Vec<u16>,
    count: usize,
}

/// Lights that are divided together.
struct LightPart<'a> {
    lights: Vec<&'a Light>,
    clusters: usize,
}

impl Clusters {
    /// Most clusters of any basis: lights that are known by their images alone.
    pub const MAX: usize = SINGLE_IMAGES;
    /// Most clusters of a basis of other lights.
    pub const MAX_WITH_PLACES: usize = SINGLE_COLUMNS;

    /// The clusters of a basis.
    pub fn of_basis(basis: &LightBasis) -> Self {
        if basis.column_count() <= SINGLE_COLUMNS { Self::single(basis) } else { Self::by_place_and_brightness(basis) }
    }

    /// Whether earlier planes of the format had so many clusters of a basis: with 33 columns and more in groups, at first without any
    /// for the brightest texels.
    pub(crate) fn were(basis: &LightBasis, count: usize) -> bool {
        [Self::by_place(basis), Self::by_place_and_brightness(basis)].iter().any(|clusters| clusters.count == count)
    }

    fn by_place_and_brightness(basis: &LightBasis) -> Self {
        let Self { mut of_column, count } = Self::by_place(basis);
        let bright = bright_columns(basis);
        if basis.column_count() <= FIRST_SINGLE_COLUMNS || bright.is_empty() {
            return Self { of_column, count };
        }
        for (column, cluster) in bright.into_iter().zip(count..FIRST_SINGLE_COLUMNS) {
            of_column[column] = cluster as u16;
        }
        let count = number_anew(&mut of_column);
        Self { of_column, count }
    }

    fn by_place(basis: &LightBasis) -> Self {
        let columns = basis.column_count();
        let are_images = basis.lights().iter().all(|light| light.kind == LightKind::Image);
        if columns <= if are_images { SINGLE_IMAGES } else { FIRST_SINGLE_COLUMNS } {
            return Self::single(basis);
        }
        let mut of_column = vec![0; columns];
        let mut count = 0;
        for part in parts(basis) {
            match part.lights[..] {
                [light] => cut_grid(light, part.clusters, &mut of_column, &mut count),
                _ => group_by_place(&part, &mut of_column, &mut count),
            }
        }
        Self { of_column: of_column.into_iter().map(|cluster| cluster as u16).collect(), count }
    }

    /// Every column by itself.
    fn single(basis: &LightBasis) -> Self {
        let count = basis.column_count();
        Self { of_column: (0..count as u16).collect(), count }
    }

    /// Cluster of each column.
    pub fn of_column(&self) -> &[u16] {
        &self.of_column
    }

    /// Number of clusters.
    pub fn count(&self) -> usize {
        self.count
    }
}

/// The lights as parts, with a number of clusters each, [`MAX_CLUSTERS`] in all.
fn parts(basis: &LightBasis) -> Vec<LightPart<'_>> {
    let lights = basis.lights();
    let mut parts: Vec<LightPart<'_>> = if lights.len() <= MAX_CLUSTERS {
        lights.iter().map(|light| LightPart { lights: vec![light], clusters: 1 }).collect()
    } else {
        let textured = lights.iter().filter(|light| light.places.len() > 1).count();
        // Too many lights to have a cluster each. Those with texels keep one each if they are few.
        let apart =
            |light: &Light| light.kind.is_environment() || (light.places.len() > 1 && textured + 2 <= MAX_CLUSTERS);
        let (alone, together): (Vec<_>, Vec<_>) = lights.iter().partition(|light| apart(light));
        let (suns, placed): (Vec<_>, Vec<_>) = together.into_iter().partition(|light| light.kind == LightKind::Sun);
        let alone = alone.into_iter().map(|light| vec![light]);
        let groups = alone.chain([placed, suns]).filter(|lights| !lights.is_empty());
        groups.map(|lights| LightPart { lights, clusters: 1 }).collect()
    };
    for _ in parts.len()..MAX_CLUSTERS {
        // The part whose clusters are the largest gets one more.
        let size = |part: &LightPart<'_>| {
            let columns: usize = part.lights.iter().map(|light| light.places.len()).sum();
            let most = if part.lights.len() > 1 { part.lights.len() } else { MAX_CLUSTERS_OF_LIGHT.min(columns) };
            if part.clusters < most { columns as f64 / part.clusters as f64 } else { 0.0 }
        };
        let largest = (0..parts.len()).rev().max_by(|&a, &b| size(&parts[a]).total_cmp(&size(&parts[b])));
        match largest {
            Some(largest) if size(&parts[largest]) > 0.0 => parts[largest].clusters += 1,
            _ => break,
        }
    }
    parts
}

/// Cuts the grid of one light into at most `clusters` rectangles of nearly equal size, as square as they can be.
fn cut_grid(light: &Light, clusters: usize, of_column: &mut [usize], count: &mut usize) {
    let (across, down) = light.layout();
    let (across, down) = (across as usize, down as usize);
    let cuts = (1..=clusters.min(across)).map(|a| (a, (clusters / a).min(down)));
    let longest = |&(a, b): &(usize, usize)| (across as f64 / a as f64).max(down as f64 / b as f64);
    let (a, b) = cuts.min_by(|x, y| longest(x).total_cmp(&longest(y))).expect("a light has a cluster");
    for (texel, column) in light.columns().enumerate() {
        let (u, v) = (texel % across, texel / across);
        of_column[column as usize] = *count + v * b / down * a + u * a / across;
    }
    *count += a * b;
}

/// Texels that have at least [`BRIGHT_SHARE`] of the power of their light in the scene's own lighting; the brightest first.
fn bright_columns(basis: &LightBasis) -> Vec<usize> {
    let weights = basis.scene_weights();
    let mut bright = Vec::new();
    for light in basis.lights().iter().filter(|light| light.places.len() > 1) {
        let power = |(column, extent): (u32, &f32)| {
            let weight: f32 = weights[column as usize].iter().sum();
            f64::from(weight.max(0.0)) * f64::from(*extent)
        };
        let powers: Vec<f64> = light.columns().zip(&light.extents).map(power).collect();
        let all: f64 = powers.iter().sum();
        let shares = light.columns().zip(&powers).map(|(column, power)| (power / all, column as usize));
        // Of a light with few texels each has as much without being brighter than the others.
        let least = BRIGHT_SHARE.max(2.0 / powers.len() as f64);
        bright.extend(shares.filter(|(share, _)| *share >= least));
    }
    bright.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    bright.into_iter().map(|(_, column)| column).collect()
}

/// Numbers clusters as they first appear, so that none is empty, and gives their number.
fn number_anew(of_column: &mut [u16]) -> usize {
    let mut numbers = std::collections::BTreeMap::new();
    for cluster in of_column {
        let next = numbers.len() as u16;
        *cluster = *numbers.entry(*cluster).or_insert(next);
    }
    numbers.len()
}

/// Groups lights by k-means over their places (for suns: directions): the first centre is the first light, each
/// further one the light farthest from those before, then Lloyd's iteration (1982).
fn group_by_place(part: &LightPart<'_>, of_column: &mut [usize], count: &mut usize) {
    let centre = |light: &&Light| {
        let scale = 1.0 / light.places.len() as f64;
        [0, 1, 2].map(|k| light.places.iter().map(|place| f64::from(place[k])).sum::<f64>() * scale)
    };
    let points: Vec<[f64; 3]> = part.lights.iter().map(centre).collect();
    let distance = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>();
    let nearest = |point: &[f64; 3], centres: &[[f64; 3]]| {
        let by = |&a: &usize, &b: &usize| distance(point, &centres[a]).total_cmp(&distance(point, &centres[b]));
        (0..centres.len()).min_by(by).expect("there is a centre")
    };
    let mut centres = vec![points[0]];
    while centres.len() < part.clusters {
        let reach = |point: &[f64; 3]| distance(point, &centres[nearest(point, &centres)]);
        let farthest = points.iter().max_by(|a, b| reach(a).total_cmp(&reach(b))).expect("a part has lights");
        if reach(farthest) == 0.0 {
            break;
        }
        centres.push(*farthest);
    }
    let mut owners: Vec<usize> = points.iter().map(|point| nearest(point, &centres)).collect();
    for _ in 0..ITERATIONS {
        for (own, centre) in centres.iter_mut().enumerate() {
            let members: Vec<_> = points.iter().zip(&owners).filter(|(_, owner)| **owner == own).collect();
            if !members.is_empty() {
                let mean = |k: usize| members.iter().map(|(point, _)| point[k]).sum::<f64>() / members.len() as f64;
                *centre = [0, 1, 2].map(mean);
            }
        }
        let moved: Vec<usize> = points.iter().map(|point| nearest(point, &centres)).collect();
        if std::mem::replace(&mut owners, moved.clone()) == moved {
            break;
        }
    }
    // Numbered as they first appear, so that none is empty.
    let mut numbers = vec![None; centres.len()];
    for (light, owner) in part.lights.iter().zip(owners) {
        let number = *numbers[owner].get_or_insert_with(|| {
            *count += 1;
            *count - 1
        });
        light.columns().for_each(|column| of_column[column as usize] = number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A light whose columns stand along x from `x` on, a tenth apart.
    fn light(name: String, kind: LightKind, x: f32) -> Light {
        let mut light = Light::unplaced(name, kind);
        light.places.iter_mut().enumerate().for_each(|(i, place)| place[0] = x + 0.1 * i as f32);
        light
    }

    fn basis(lights: impl IntoIterator<Item = (LightKind, f32)>) -> LightBasis {
        let mut basis = LightBasis::new();
        for (i, (kind, x)) in lights.into_iter().enumerate() {
            basis.push(light(format!("light {i}"), kind, x)).unwrap();
        }
        basis
    }

    /// Columns of each cluster; checks that there are no empty ones and no others.
    fn sizes(clusters: &Clusters) -> Vec<usize> {
        let mut sizes = vec![0; clusters.count()];
        clusters.of_column().iter().for_each(|&cluster| sizes[usize::from(cluster)] += 1);
        assert!(sizes.iter().all(|&size| size > 0) && sizes.len() <= Clusters::MAX, "{sizes:?}");
        sizes
    }

    #[test]
    fn few_columns_are_clusters_of_their_own() {
        let images = Clusters::of_basis(&basis((0..100).map(|i| (LightKind::Image, i as f32))));
        assert_eq!(images.of_column(), (0..100).collect::<Vec<_>>());
        let clusters = Clusters::of_basis(&basis((0..80).map(|i| (LightKind::Point, i as f32))));
        assert_eq!(clusters.of_column(), (0..80).collect::<Vec<_>>());
        let sky = basis([(LightKind::LatLong { across: 8, down: 4 }, 0.0), (LightKind::Sun, 0.0)]);
        assert_eq!(Clusters::of_basis(&sky).count(), 33);
        let before = Clusters::by_place(&sky).count();
        assert!(before < 32 && Clusters::were(&sky, before) && !Clusters::were(&sky, 33), "{before}");
        assert_eq!(Clusters::of_basis(&LightBasis::new()).count(), 0);
    }

    /// A map with a sun, a lesser one, and one that is only somewhat brighter than the sky.
    #[test]
    fn what_is_brightest_in_a_map_is_a_cluster_of_its_own() {
        let mut basis = basis([(LightKind::LatLong { across: 64, down: 16 }, 0.0)]);
        let mut weights = vec![[1.0; 3]; 1024];
        (weights[70], weights[71], weights[900]) = ([5000.0; 3], [400.0; 3], [30.0; 3]);
        basis.set_scene_weights(0, weights).unwrap();
        let clusters = Clusters::of_basis(&basis);
        let sizes = sizes(&clusters);
        assert_eq!((clusters.count(), sizes.iter().filter(|&&size| size == 1).count()), (18, 2), "{sizes:?}");
        assert!([70, 71].map(|column: usize| sizes[usize::from(clusters.of_column()[column])]) == [1, 1]);
    }

    #[test]
    fn a_panel_is_cut_into_squares_and_a_map_into_tiles() {
        let panel = Clusters::of_basis(&basis([(LightKind::AreaTexels { across: 32, down: 32 }, 0.0)]));
        assert_eq!(sizes(&panel), [64; 16]);
        let at = |u: usize, v: usize| panel.of_column()[v * 32 + u];
        assert_eq!((at(0, 0), at(7, 7), at(8, 7), at(0, 8), at(31, 31)), (0, 0, 1, 4, 15));
        let map = Clusters::of_basis(&basis([(LightKind::LatLong { across: 64, down: 16 }, 0.0)]));
        assert_eq!(sizes(&map), [64; 16], "8 × 2 tiles of 8 × 8 texels");
        let strip = Clusters::of_basis(&basis([(LightKind::AreaTexels { across: 200, down: 1 }, 0.0)]));
        assert_eq!(strip.count(), 16);
    }

    #[test]
    fn every_light_has_a_cluster_while_there_are_enough_and_larger_ones_more() {
        let panel = LightKind::AreaTexels { across: 16, down: 16 };
        let small = LightKind::AreaTexels { across: 4, down: 4 };
        let clusters =
            Clusters::of_basis(&basis([(panel, 0.0), (small, 5.0), (LightKind::Point, 9.0), (LightKind::Sun, 0.0)]));
        let sizes = sizes(&clusters);
        let of = |column: usize| usize::from(clusters.of_column()[column]);
        assert_eq!((sizes[of(272)], sizes[of(273)]), (1, 1), "the lamp and the sun stand alone");
        assert_eq!(of(255) + 1, 16, "the larger panel has as many as one light may have");
        assert!(of(271) + 1 > 16 && sizes.len() <= 24, "{sizes:?}");
    }

    #[test]
    fn many_lamps_are_grouped_by_place_and_suns_apart() {
        // Five heaps of forty lamps, and three suns: heaps are never mixed while there are more clusters than heaps.
        let lamps = (0..200).map(|i| (LightKind::Lamp, 100.0 * (i % 5) as f32 + 0.01 * i as f32));
        let suns = (0..3).map(|i| (LightKind::Sun, i as f32));
        let clusters = Clusters::of_basis(&basis(lamps.chain(suns)));
        sizes(&clusters);
        for i in 0..200 {
            for j in 0..i {
                let together = clusters.of_column()[i] == clusters.of_column()[j];
                assert!(!together || i % 5 == j % 5, "lamps {i} and {j}");
            }
            assert!((200..203).all(|sun| clusters.of_column()[i] != clusters.of_column()[sun]));
        }
    }

    #[test]
    fn many_panels_and_lamps_at_one_place_still_make_clusters() {
        let panels = (0..40).map(|i| (LightKind::AreaTexels { across: 4, down: 4 }, 3.0 * i as f32));
        let clusters = Clusters::of_basis(&basis(panels.chain([(LightKind::LatLong { across: 8, down: 4 }, 0.0)])));
        sizes(&clusters);
        assert!(clusters.count() > 8);
        let heap = Clusters::of_basis(&basis((0..150).map(|_| (LightKind::Point, 1.0))));
        assert_eq!(sizes(&heap), [150]);
    }
}
