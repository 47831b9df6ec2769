//! Names: which channels are the colours of which layer, seen from where.

use std::collections::{BTreeSet, HashMap};

use exr::meta::MetaData;
use exr::meta::attribute::Text;

/// A channel's part of the file, and its number there.
pub(in crate::image) type ChannelPlace = (usize, usize);

/// A channel of a file.
#[derive(Clone, Debug)]
pub(in crate::image) struct Channel {
    /// The part of its name before the last dot.
    pub(in crate::image) layer: String,
    pub(in crate::image) name: String,
    pub(in crate::image) view: Option<String>,
    pub(in crate::image) place: ChannelPlace,
}

/// Channels that are one picture.
#[derive(Clone, Debug)]
pub(in crate::image) struct ExrLayer {
    /// Name in the file.
    pub(in crate::image) name: String,
    /// Name without that of its view.
    pub(in crate::image) stem: String,
    /// Whose eye it is, in a file of several.
    pub(in crate::image) view: Option<String>,
    /// None for what is no picture: a depth, vectors, numbers of objects.
    pub(in crate::image) colours: Option<Colours>,
    pub(in crate::image) alpha: Option<ChannelPlace>,
}

/// Colour model of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::image) enum Colours {
    /// Red, green and blue.
    Rgb([ChannelPlace; 3]),
    /// Luminance alone: `Y`.
    Grey(ChannelPlace),
    /// Luminance and the shares of red and blue: `Y`, `RY`, `BY`.
    Chroma([ChannelPlace; 3]),
}

/// Names that Blender gives the eyes where it does not list them.
const EYES: [&str; 2] = ["left", "right"];

/// A text of a file: UTF-8 as the format wants it, else by Latin-1, which older writers used.
pub(in crate::image) fn text(stored: &Text) -> String {
    let bytes = stored.as_slice();
    std::str::from_utf8(bytes).map_or_else(|_| bytes.iter().map(|&b| char::from(b)).collect(), str::to_owned)
}

/// The channels of the parts that are flat pictures, in the order of the file.
pub(in crate::image) fn channels(meta: &MetaData) -> Vec<Channel> {
    let mut channels = Vec::new();
    for (part, header) in meta.headers.iter().enumerate().filter(|(_, header)| !header.deep) {
        let part_name = header.own_attributes.layer_name.as_ref().map(text).unwrap_or_default();
        let part_view = header.own_attributes.view_name.as_ref().map(text);
        let views: Vec<String> = header.own_attributes.multi_view_names.iter().flatten().map(text).collect();
        for (index, channel) in header.channels.list.iter().enumerate() {
            let channel = text(&channel.name);
            // Blender's parts repeat their name in their channels' names.
            let repeats = part_name.is_empty() || channel.starts_with(&part_name);
            let full = if repeats { channel } else { format!("{part_name}.{channel}") };
            let (layer, name) = full.rsplit_once('.').unwrap_or(("", &full));
            let own = views.iter().find(|view| last(layer) == view.as_str());
            // The first view of the list needs no name in those of its channels.
            let listed = if views.len() > 1 { own.or(views.first()).cloned() } else { None };
            let view = part_view.clone().or(listed);
            channels.push(Channel { layer: layer.to_owned(), name: name.to_owned(), view, place: (part, index) });
        }
    }
    name_eyes(&mut channels);
    channels
}

/// The part of a name after its last dot.
fn last(name: &str) -> &str {
    name.rsplit_once('.').map_or(name, |(_, last)| last)
}

/// Tells the views of files that do not: layers `X.left` beside `X.right`.
fn name_eyes(channels: &mut [Channel]) {
    if channels.iter().any(|channel| channel.view.is_some()) {
        return;
    }
    let known: BTreeSet<String> = channels.iter().map(|channel| channel.layer.to_lowercase()).collect();
    for channel in channels {
        let lower = channel.layer.to_lowercase();
        let Some((stem, eye)) = lower.rsplit_once('.') else { continue };
        if EYES.contains(&eye) && EYES.iter().all(|eye| known.contains(&format!("{stem}.{eye}"))) {
            channel.view = Some(last(&channel.layer).to_owned());
        }
    }
}

/// The name of a layer without that of its view, which stands at its end.
fn without_view(layer: &str, view: Option<&str>) -> String {
    let stem = view.and_then(|view| layer.strip_suffix(view));
    let stem = stem.and_then(|stem| if stem.is_empty() { Some(stem) } else { stem.strip_suffix(['.', '_', ' ', '-']) });
    stem.unwrap_or(layer).to_owned()
}

/// The channels of a layer found so far.
#[derive(Clone, Debug, Default)]
struct Slots {
    rgb: [Option<ChannelPlace>; 3],
    luma: [Option<ChannelPlace>; 3],
    alpha: Option<ChannelPlace>,
    /// Whether there are channels of vectors or depths.
    has_others: bool,
}

impl Slots {
    /// Puts a channel where its name says; false if there is one already.
    fn put(&mut self, name: &str, place: ChannelPlace) -> bool {
        let upper = name.to_ascii_uppercase();
        let slot = match upper.as_str() {
            "R" | "RED" => &mut self.rgb[0],
            "G" | "GREEN" => &mut self.rgb[1],
            "B" | "BLUE" => &mut self.rgb[2],
            "Y" => &mut self.luma[0],
            "RY" => &mut self.luma[1],
            "BY" => &mut self.luma[2],
            "A" | "ALPHA" => &mut self.alpha,
            _ => {
                self.has_others |= matches!(upper.as_str(), "X" | "Z" | "W" | "U" | "V");
                return true;
            }
        };
        let is_free = slot.is_none();
        slot.get_or_insert(place);
        is_free
    }

    fn colours(&self) -> Option<Colours> {
        if let [Some(r), Some(g), Some(b)] = self.rgb {
            return Some(Colours::Rgb([r, g, b]));
        }
        match self.luma {
            _ if self.has_others || self.rgb != [None; 3] => None,
            [Some(y), Some(ry), Some(by)] => Some(Colours::Chroma([y, ry, by])),
            [Some(y), None, None] => Some(Colours::Grey(y)),
            _ => None,
        }
    }
}

/// The layers that channels make, in the order of the file.
pub(in crate::image) fn layers(channels: &[Channel]) -> Vec<ExrLayer> {
    let mut found: Vec<(&Channel, Slots)> = Vec::new();
    let mut known: HashMap<(&str, Option<&str>), usize> = HashMap::new();
    for channel in channels {
        let key = (channel.layer.as_str(), channel.view.as_deref());
        let index = *known.entry(key).or_insert_with(|| {
            found.push((channel, Slots::default()));
            found.len() - 1
        });
        if !found[index].1.put(&channel.name, channel.place) {
            // Another part of the same name.
            let mut slots = Slots::default();
            slots.put(&channel.name, channel.place);
            known.insert(key, found.len());
            found.push((channel, slots));
        }
    }
    let layer = |(first, slots): (&Channel, Slots)| ExrLayer {
        name: first.layer.clone(),
        stem: without_view(&first.layer, first.view.as_deref()),
        view: first.view.clone(),
        colours: slots.colours(),
        alpha: slots.alpha,
    };
    found.into_iter().map(layer).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channel(full: &str, view: Option<&str>) -> Channel {
        let (layer, name) = full.rsplit_once('.').unwrap_or(("", full));
        Channel { layer: layer.into(), name: name.into(), view: view.map(str::to_owned), place: (0, 0) }
    }

    fn kinds(names: &[&str]) -> Vec<(String, &'static str)> {
        let channels: Vec<Channel> = names.iter().map(|name| channel(name, None)).collect();
        let kind = |layer: ExrLayer| {
            let kind = match layer.colours {
                Some(Colours::Rgb(_)) => "rgb",
                Some(Colours::Grey(_)) => "grey",
                Some(Colours::Chroma(_)) => "chroma",
                None => "none",
            };
            (layer.name, kind)
        };
        layers(&channels).into_iter().map(kind).collect()
    }

    #[test]
    fn colours_are_told_from_vectors_and_depths() {
        let names = ["A.r", "A.g", "A.b", "N.X", "N.Y", "N.Z", "D.Z", "Y", "BY", "RY", "grey.Y", "id.R"];
        let kinds = kinds(&names);
        let kinds: Vec<_> = kinds.iter().map(|(name, kind)| (name.as_str(), *kind)).collect();
        assert_eq!(
            kinds,
            [("A", "rgb"), ("N", "none"), ("D", "none"), ("", "chroma"), ("grey", "grey"), ("id", "none")]
        );
    }

    #[test]
    fn eyes_are_told_where_both_are_there() {
        let mut both = [channel("V.key.left.R", None), channel("V.key.right.R", None), channel("V.left.R", None)];
        name_eyes(&mut both);
        let views: Vec<_> = both.iter().map(|channel| channel.view.as_deref()).collect();
        assert_eq!(views, [Some("left"), Some("right"), None]);
        assert_eq!(without_view("V.key.left", Some("left")), "V.key");
        assert_eq!(without_view("rgba_right", Some("right")), "rgba");
        assert_eq!(without_view("upright", Some("right")), "upright");
        assert_eq!(without_view("right", Some("right")), "");
    }

    #[test]
    fn names_are_utf_8_and_latin_1_where_they_are_not() {
        let stored = |bytes: &[u8]| text(&Text::from_slice_unchecked(bytes));
        assert_eq!(stored("Küche_Ost 照明".as_bytes()), "Küche_Ost 照明");
        assert_eq!(stored(b"K\xfcche"), "Küche");
    }
}
