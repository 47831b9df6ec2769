//! Lights whose images denoising can tell apart.

use super::{Clusters, LightBasis};

/// A partition of the lights of a basis: the finest in which no cluster of columns has columns of lights in two groups. With few
/// columns each light is a group of its own; of many lamps those that share clusters are one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LightGroups {
    of_light: Vec<u16>,
    of_cluster: Vec<u16>,
    count: usize,
}

impl LightGroups {
    /// The groups of a basis and its clusters.
    pub fn of_basis(basis: &LightBasis, clusters: &Clusters) -> Self {
        // The groups of clusters that lights have joined so far, by the least cluster of each.
        let mut joined: Vec<usize> = (0..clusters.count()).collect();
        for light in basis.lights() {
            let of_light = light.columns().map(|column| usize::from(clusters.of_column()[column as usize]));
            let groups: Vec<usize> = of_light.map(|cluster| joined[cluster]).collect();
            if let Some(&least) = groups.iter().min() {
                joined.iter_mut().filter(|group| groups.contains(group)).for_each(|group| *group = least);
            }
        }
        let mut firsts = joined.clone();
        firsts.sort_unstable();
        firsts.dedup();
        let number = |group: usize| firsts.partition_point(|&first| first < group) as u16;
        let of_cluster: Vec<u16> = joined.into_iter().map(number).collect();
        let of_light = basis.lights().iter().map(|light| {
            light.columns().next().map_or(0, |column| of_cluster[usize::from(clusters.of_column()[column as usize])])
        });
        Self { of_light: of_light.collect(), count: firsts.len(), of_cluster }
    }

    /// The group of each light.
    pub fn of_light(&self) -> &[u16] {
        &self.of_light
    }

    /// The group of each cluster.
    pub fn of_cluster(&self) -> &[u16] {
        &self.of_cluster
    }

    /// Number of groups.
    pub fn count(&self) -> usize {
        self.count
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::{Light, LightKind};

    fn groups(kinds: impl IntoIterator<Item = LightKind>) -> LightGroups {
        let mut basis = LightBasis::new();
        for (i, kind) in kinds.into_iter().enumerate() {
            let mut light = Light::unplaced(format!("light {i}"), kind);
            light.places.iter_mut().for_each(|place| place[0] = i as f32);
            basis.push(light).unwrap();
        }
        LightGroups::of_basis(&basis, &Clusters::of_basis(&basis))
    }

    #[test]
    fn few_lights_are_each_a_group_however_many_texels_they_have() {
        let panel = LightKind::AreaTexels { across: 16, down: 16 };
        let groups = groups([LightKind::Point, panel, LightKind::Sun]);
        assert_eq!((groups.of_light(), groups.count()), (&[0, 1, 2][..], 3));
        // The clusters of the panel are all of its group.
        let of_panel = groups.of_cluster().iter().filter(|&&group| group == 1).count();
        assert!(of_panel > 4 && of_panel + 2 == groups.of_cluster().len(), "{groups:?}");
    }

    #[test]
    fn lamps_that_share_a_cluster_share_a_group() {
        let mut basis = LightBasis::new();
        for lamp in 0..200 {
            let mut light = Light::unplaced(format!("lamp {lamp}"), LightKind::Point);
            light.places[0][0] = lamp as f32;
            basis.push(light).unwrap();
        }
        let clusters = Clusters::of_basis(&basis);
        let groups = LightGroups::of_basis(&basis, &clusters);
        assert_eq!(groups.count(), clusters.count());
        for (lamp, &cluster) in clusters.of_column().iter().enumerate() {
            assert_eq!(groups.of_light()[lamp], groups.of_cluster()[usize::from(cluster)]);
        }
    }
}
