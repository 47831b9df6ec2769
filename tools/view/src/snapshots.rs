//! Pictures kept to come back to and to compare with.

use std::sync::Arc;

use super::mixer::Mix;
use ltm::image::LinearImage;

/// A lighting with the picture that it made.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Name, unique among the snapshots.
    pub name: String,
    /// The lighting; none for a reference that came as an image.
    pub mix: Option<Mix>,
    /// The picture.
    pub image: Arc<LinearImage>,
}

/// All snapshots, and which one the picture is compared with.
#[derive(Clone, Debug, Default)]
pub struct Snapshots {
    list: Vec<Snapshot>,
    /// Number of the next name, which is not used again after a snapshot is gone.
    named: u32,
    compared: Option<usize>,
    /// Where the wipe stands, from 0 at the picture's left edge (all current) to 1 at its right.
    pub wipe: f32,
}

impl Snapshots {
    /// The snapshots, oldest first.
    pub fn list(&self) -> &[Snapshot] {
        &self.list
    }

    /// Keeps a lighting and its picture under the next free name; its index.
    pub fn take(&mut self, mix: Mix, image: Arc<LinearImage>) -> usize {
        self.named += 1;
        self.add(format!("Snapshot {}", self.named), Some(mix), image)
    }

    /// Adds an image to compare with; its index. A reference of this name is replaced.
    pub fn add_reference(&mut self, name: &str, image: Arc<LinearImage>) -> usize {
        match self.list.iter().position(|s| s.name == name && s.mix.is_none()) {
            Some(index) => {
                self.list[index].image = image;
                index
            }
            None => self.add(name.to_owned(), None, image),
        }
    }

    fn add(&mut self, name: String, mix: Option<Mix>, image: Arc<LinearImage>) -> usize {
        self.list.push(Snapshot { name, mix, image });
        self.list.len() - 1
    }

    /// Takes one away; a comparison with it ends.
    pub fn remove(&mut self, index: usize) {
        self.list.remove(index);
        self.compared = match self.compared {
            Some(compared) if compared == index => None,
            Some(compared) if compared > index => Some(compared - 1),
            other => other,
        };
    }

    /// The one that the picture is compared with.
    pub fn compared(&self) -> Option<usize> {
        self.compared
    }

    /// Begins a comparison with one, with the wipe in the middle; ends it if it is the one already.
    pub fn toggle_compare(&mut self, index: usize) {
        if self.compared == Some(index) {
            self.compared = None;
        } else {
            if self.compared.is_none() {
                self.wipe = 0.5;
            }
            self.compared = Some(index);
        }
    }
}

/// The picture made small: at most `side` pixels along its longer side, each the mean of what it covers.
pub fn thumbnail(image: &LinearImage, side: u32) -> LinearImage {
    let scale = (f64::from(side) / f64::from(image.width.max(image.height).max(1))).min(1.0);
    let size = |v: u32| ((f64::from(v) * scale).round() as u32).clamp(1, side.max(1));
    let mut small = LinearImage::black(size(image.width), size(image.height));
    let span = |i: u32, of: u32, full: u32| {
        let begin = (u64::from(i) * u64::from(full) / u64::from(of)) as u32;
        let end = (u64::from(i + 1) * u64::from(full) / u64::from(of)) as u32;
        begin..end.max(begin + 1).min(full)
    };
    for y in 0..small.height {
        for x in 0..small.width {
            let mut sum = [0.0f64; 3];
            let mut count = 0u32;
            for row in span(y, small.height, image.height) {
                for column in span(x, small.width, image.width) {
                    let pixel = image.pixels[row as usize * image.width as usize + column as usize];
                    sum = [0, 1, 2].map(|ch| sum[ch] + f64::from(pixel[ch]));
                    count += 1;
                }
            }
            small.pixels[(y * small.width + x) as usize] = sum.map(|v| (v / f64::from(count.max(1))) as f32);
        }
    }
    small
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(width: u32, height: u32) -> LinearImage {
        LinearImage { width, height, pixels: (0..width * height).map(|i| [i as f32; 3]).collect() }
    }

    fn empty() -> Mix {
        Mix { lights: Vec::new(), groups: Vec::new() }
    }

    #[test]
    fn names_stay_unique_and_a_comparison_follows_its_snapshot() {
        let mut snapshots = Snapshots::default();
        let picture = Arc::new(image(2, 2));
        for _ in 0..3 {
            snapshots.take(empty(), picture.clone());
        }
        snapshots.toggle_compare(2);
        assert_eq!((snapshots.compared(), snapshots.wipe), (Some(2), 0.5));
        snapshots.remove(0);
        assert_eq!(snapshots.compared(), Some(1));
        assert_eq!(snapshots.list()[1].name, "Snapshot 3");
        snapshots.take(empty(), picture.clone());
        assert_eq!(snapshots.list()[2].name, "Snapshot 4");
        snapshots.remove(1);
        assert_eq!(snapshots.compared(), None);
        let reference = snapshots.add_reference("truth.exr", picture.clone());
        assert_eq!(snapshots.add_reference("truth.exr", picture), reference);
    }

    #[test]
    fn a_thumbnail_keeps_the_mean_and_the_proportions() {
        let small = thumbnail(&image(64, 32), 16);
        assert_eq!((small.width, small.height), (16, 8));
        let mean = |image: &LinearImage| image.pixels.iter().map(|p| p[0]).sum::<f32>() / image.pixels.len() as f32;
        assert!((mean(&small) - mean(&image(64, 32))).abs() < 0.01);
        assert_eq!(thumbnail(&image(3, 1000), 10).width, 1);
        assert_eq!(thumbnail(&image(3, 2), 10), image(3, 2));
    }
}
