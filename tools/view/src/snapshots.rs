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
    /// The picture; none until it is made, of a snapshot that was read from a lighting file.
    pub image: Option<Arc<LinearImage>>,
    /// Whether the picture was made for a display, and is shown as it is.
    pub is_displayed: bool,
}

/// All snapshots, and which one the picture is compared with.
#[derive(Clone, Debug, Default)]
pub struct Snapshots {
    list: Vec<Snapshot>,
    /// Number of the next name, which is not used again after a snapshot is gone.
    named: u32,
    compared: Option<usize>,
    revision: u64,
    /// Where the wipe stands, from 0 at the picture's left edge (all current) to 1 at its right.
    pub wipe: f32,
}

impl Snapshots {
    /// The snapshots, oldest first.
    pub fn list(&self) -> &[Snapshot] {
        &self.list
    }

    /// Grows with every change of a lighting or its name.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// The lightings with their names.
    pub fn mixes(&self) -> Vec<(String, Mix)> {
        self.list.iter().filter_map(|s| Some((s.name.clone(), s.mix.clone()?))).collect()
    }

    /// Keeps a lighting and its picture under the next free name; its index.
    pub fn take(&mut self, mix: Mix, image: Arc<LinearImage>) -> usize {
        let name = loop {
            self.named += 1;
            let name = format!("Snapshot {}", self.named);
            if self.find(&name).is_none() {
                break name;
            }
        };
        self.revision += 1;
        self.add(Snapshot { name, mix: Some(mix), image: Some(image), is_displayed: false })
    }

    /// Takes the lightings of a file instead of all that came from lightings. Those that are as before keep their pictures.
    pub fn read(&mut self, mixes: Vec<(String, Mix)>) {
        let compared = self.compared.map(|index| self.list[index].name.clone());
        let old = std::mem::take(&mut self.list);
        for (name, mix) in mixes {
            let same = |s: &&Snapshot| s.name == name && s.mix.as_ref() == Some(&mix);
            let image = old.iter().find(same).and_then(|s| s.image.clone());
            self.list.push(Snapshot { name, mix: Some(mix), image, is_displayed: false });
        }
        self.list.extend(old.into_iter().filter(|s| s.mix.is_none()));
        self.compared = compared.and_then(|name| self.find(&name));
        self.revision += 1;
    }

    /// These snapshots over the lights of another container: their pictures are to be made again, and references are kept
    /// that have its size.
    pub fn carried(&self, size: [u32; 2], carry: impl Fn(&Mix) -> Mix) -> Self {
        let mut carried = Self { list: Vec::new(), compared: None, ..self.clone() };
        for snapshot in &self.list {
            let fits = |image: &Arc<LinearImage>| [image.width, image.height] == size;
            match (&snapshot.mix, &snapshot.image) {
                (Some(mix), _) => {
                    carried.list.push(Snapshot { mix: Some(carry(mix)), image: None, ..snapshot.clone() });
                }
                (None, Some(image)) if fits(image) => carried.list.push(snapshot.clone()),
                (None, _) => {}
            }
        }
        carried
    }

    /// As [`carried`](Self::carried), over a finer picture of the same view: references of any size are kept, and so is what is compared.
    #[must_use]
    pub fn refined(&self, carry: impl Fn(&Mix) -> Mix) -> Self {
        let mut refined = self.clone();
        for snapshot in &mut refined.list {
            if let Some(mix) = &snapshot.mix {
                (snapshot.mix, snapshot.image) = (Some(carry(mix)), None);
            }
        }
        refined
    }

    /// Shows the comparison as it is shown of these.
    pub fn follow(&mut self, of: &Self) {
        (self.compared, self.wipe) = (of.compared.filter(|index| *index < self.list.len()), of.wipe);
    }

    /// Takes the lightings of the snapshots of another view of the scene: their pictures are this view's own, as are references. A lighting
    /// that is compared with there is compared with here.
    pub fn share(&mut self, of: &Self) {
        self.read(of.mixes());
        (self.revision, self.named, self.wipe) = (of.revision, self.named.max(of.named), of.wipe);
        let lighting = |index: usize, of: &Self| of.list.get(index).filter(|s| s.mix.is_some()).map(|s| s.name.clone());
        match of.compared.map(|index| lighting(index, of)) {
            Some(Some(name)) => self.compared = self.find(&name),
            // What it is compared with has no part in this view.
            Some(None) => {}
            None => self.compared = self.compared.filter(|&index| lighting(index, self).is_none()),
        }
    }

    /// Makes other mixes of the lightings that give the same pictures.
    pub fn map_mixes(&mut self, make: impl Fn(&Mix) -> Mix) {
        self.list.iter_mut().filter_map(|snapshot| snapshot.mix.as_mut()).for_each(|mix| *mix = make(mix));
    }

    /// Takes the pictures that the same snapshots have elsewhere.
    pub fn take_images(&mut self, of: &Self) {
        for snapshot in &mut self.list {
            let found = of.list.iter().find(|other| other.name == snapshot.name && other.mix == snapshot.mix);
            if let Some(image) = found.and_then(|other| other.image.clone()) {
                snapshot.image = Some(image);
            }
        }
    }

    /// The first snapshot that still lacks its picture.
    pub fn without_image(&self) -> Option<(&str, &Mix)> {
        let lacking = self.list.iter().find(|s| s.image.is_none())?;
        Some((&lacking.name, lacking.mix.as_ref()?))
    }

    /// Gives a snapshot its picture.
    pub fn set_image(&mut self, name: &str, image: Arc<LinearImage>) {
        if let Some(snapshot) = self.list.iter_mut().find(|s| s.name == name) {
            snapshot.image = Some(image);
        }
    }

    /// Gives a snapshot another name; says whether it could: the name is not empty and none has it.
    pub fn rename(&mut self, index: usize, name: &str) -> bool {
        let name = name.trim();
        let fits = !name.is_empty() && self.find(name).is_none_or(|other| other == index);
        if fits && self.list[index].name != name {
            self.list[index].name = name.to_owned();
            self.revision += 1;
        }
        fits
    }

    fn find(&self, name: &str) -> Option<usize> {
        self.list.iter().position(|s| s.name == name)
    }

    /// Adds an image to compare with; its index. A reference of this name is replaced.
    pub fn add_reference(&mut self, name: &str, image: Arc<LinearImage>, is_displayed: bool) -> usize {
        if let Some(index) = self.list.iter().position(|s| s.name == name && s.mix.is_none()) {
            (self.list[index].image, self.list[index].is_displayed) = (Some(image), is_displayed);
            return index;
        }
        let mut names = std::iter::once(name.to_owned()).chain((2..).map(|number| format!("{name} {number}")));
        let name = names.find(|name| self.find(name).is_none()).unwrap_or_default();
        self.add(Snapshot { name, mix: None, image: Some(image), is_displayed })
    }

    fn add(&mut self, snapshot: Snapshot) -> usize {
        self.list.push(snapshot);
        self.list.len() - 1
    }

    /// Takes one away; a comparison with it ends.
    pub fn remove(&mut self, index: usize) {
        self.revision += u64::from(self.list.remove(index).mix.is_some());
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
        Mix { lights: Vec::new(), groups: crate::groups::Groups::none(0) }
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
        let reference = snapshots.add_reference("truth.exr", picture.clone(), false);
        assert_eq!(snapshots.add_reference("truth.exr", picture, true), reference);
    }

    #[test]
    fn a_file_s_looks_take_the_place_of_snapshots_and_keep_the_pictures_of_those_that_are_the_same() {
        let mut snapshots = Snapshots::default();
        let picture = Arc::new(image(2, 2));
        snapshots.take(empty(), picture.clone());
        assert!(snapshots.rename(0, " night ") && !snapshots.rename(0, " "));
        snapshots.add_reference("night.png", picture.clone(), true);
        snapshots.toggle_compare(1);
        let revision = snapshots.revision();
        snapshots.read(vec![("day".into(), empty()), ("night".into(), empty())]);
        let names: Vec<&str> = snapshots.list().iter().map(|s| s.name.as_str()).collect();
        assert_eq!((names, snapshots.compared()), (vec!["day", "night", "night.png"], Some(2)));
        assert!(snapshots.list()[1].image.is_some() && snapshots.revision() > revision);
        assert_eq!(snapshots.without_image().unwrap().0, "day");
        snapshots.set_image("day", picture);
        assert!(snapshots.without_image().is_none());
        assert!(!snapshots.rename(0, "night"), "the name is taken");
        let carried = snapshots.carried([4, 4], Mix::clone);
        assert_eq!((carried.list().len(), carried.compared()), (2, None));
        assert!(carried.list().iter().all(|s| s.image.is_none()));
    }

    #[test]
    fn views_share_lightings_and_have_pictures_and_references_of_their_own() {
        let [here, there] = [(); 2].map(|()| Arc::new(image(2, 2)));
        let [mut front, mut other] = [(); 2].map(|()| Snapshots::default());
        front.take(empty(), here.clone());
        front.add_reference("photo.png", here.clone(), true);
        front.toggle_compare(0);
        other.add_reference("sketch.png", there.clone(), true);
        other.share(&front);
        let names = |all: &Snapshots| all.list().iter().map(|s| s.name.clone()).collect::<Vec<_>>();
        assert_eq!((names(&other), other.compared()), (vec!["Snapshot 1".into(), "sketch.png".into()], Some(0)));
        assert_eq!((other.revision(), other.without_image().map(|(name, _)| name)), (1, Some("Snapshot 1")));
        other.set_image("Snapshot 1", there.clone());
        front.toggle_compare(0);
        front.rename(0, "evening");
        other.share(&front);
        assert!(other.compared().is_none() && other.list()[0].image.is_none(), "another of that name might be meant");
        other.set_image("evening", there.clone());
        other.toggle_compare(1);
        front.map_mixes(Mix::clone);
        front.share(&other);
        assert!(front.list()[0].image.as_ref().is_some_and(|image| Arc::ptr_eq(image, &here)));
        assert_eq!((names(&front), front.compared()), (vec!["evening".into(), "photo.png".into()], None));
        assert_eq!(front.revision(), other.revision());
        // A name that was given in one view is not given again in another.
        other.take(empty(), there);
        assert_eq!(other.list()[2].name, "Snapshot 2");
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
