//! What programs mean by the statements of their MTL files, where that is not what the format says. A file is one program's work:
//! its head line and all of its materials tell which.
//!
//! `formats/inputs.md` has a table.

use crate::error::Warnings;
use std::path::Path;

use glam::Vec3;

use super::MtlMaterial;

/// Who wrote a material file, as far as that changes what it means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in super::super) enum Writer {
    /// Unknown: the file is read as the format says.
    #[default]
    Unknown,
    /// Blender: a map stands for `Kd`, which keeps the colour that the map took the place of.
    Blender,
    /// Maya: every material has `illum 4`, and `Tf` is what does not pass.
    Maya,
}

/// Nearer to 0 or 1 than this is written for 0 or 1.
const SLACK: f32 = 1e-3;

impl MtlMaterial {
    /// Whether `illum` asks for glass.
    pub(super) fn is_glass(&self) -> bool {
        matches!(self.illumination, Some(4 | 6 | 7 | 9))
    }

    /// Whether it may be Maya's, of which all materials of a file are.
    fn is_mayas(&self) -> bool {
        let plain = self.ior.is_some_and(|ior| (ior - 1.0).abs() < SLACK);
        self.illumination == Some(4)
            && self.dissolve.is_none()
            && self.transparency.is_none()
            // A glass of Maya's has its index, and lets something pass.
            && (plain || (self.ior.is_some() && self.transmission.is_some_and(|tf| tf.min_element() < 1.0 - SLACK)))
    }

    /// Whether `d`, `Tr` or Maya's `Tf` lets something show through it.
    pub(in super::super) fn is_see_through(&self) -> bool {
        self.opacity().is_some_and(|opacity| opacity.min_element() < 1.0)
    }

    /// What does not pass, by `d` or `Tr`, in each channel; None where nothing is said.
    pub(super) fn opacity(&self) -> Option<Vec3> {
        let share = self.dissolve.or(self.transparency.map(|tr| 1.0 - tr));
        if self.writer == Writer::Maya {
            return self.transmission.map(|tf| tf.clamp(Vec3::ZERO, Vec3::ONE));
        }
        share.map(|share| Vec3::splat(share.clamp(0.0, 1.0)))
    }
}

/// Notes who wrote the materials of a file with these comments before the first, and turns what is written the other way round.
pub(super) fn read_as_written(path: &Path, head: &str, materials: &mut [MtlMaterial], warnings: &mut Warnings) {
    let place = path.display();
    let is_plain = |m: &MtlMaterial| m.ior.is_some_and(|ior| (ior - 1.0).abs() < SLACK);
    let writer = if head.contains("Blender") {
        Writer::Blender
    } else if materials.iter().all(MtlMaterial::is_mayas) && materials.iter().any(is_plain) {
        warnings.push(format!(
            "{place}: every material has illum 4 and none d, as Maya writes them: they are opaque but for what Tf leaves to 1"
        ));
        Writer::Maya
    } else {
        Writer::Unknown
    };
    materials.iter_mut().for_each(|material| material.writer = writer);
    // Where `Tr` makes opaque things of which nobody would see anything, it is written for `d`.
    let states = |m: &MtlMaterial| m.transparency.filter(|_| m.dissolve.is_none() && !m.is_glass());
    let whole = materials.iter().filter_map(states).filter(|tr| *tr > 1.0 - SLACK).count();
    let none = materials.iter().filter_map(states).filter(|tr| *tr < SLACK).count();
    if whole > 0 && none == 0 {
        for material in materials.iter_mut().filter(|m| m.dissolve.is_none() && !m.is_glass()) {
            material.dissolve = material.transparency;
        }
        warnings.push(format!(
            "{place}: 'Tr' 1 would leave nothing to see of {whole} materials: it is read as opacity, as photogrammetry writes it"
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::super::parse;
    use super::*;

    fn read(text: &str) -> (Vec<MtlMaterial>, Vec<String>) {
        let mut warnings = Warnings::new();
        let materials = parse(Path::new("a.mtl"), text.as_bytes(), &mut warnings).unwrap();
        (materials, warnings.lines())
    }

    #[test]
    fn a_library_of_illum_4_without_d_is_mayas() {
        let maya = "newmtl lambert1SG\nillum 4\nKd 0.6 0.3 0.2\nTf 1.00 1.00 1.00\nNi 1.00\n\
            newmtl glassSG\nillum 4\nKd 0.5 0.5 0.5\nTf 0.20 0.20 0.20\nNi 1.00\n\
            newmtl lensSG\nillum 4\nTf 0.00 0.00 0.00\nNi 1.80\n";
        let (found, lines) = read(maya);
        assert!(found.iter().all(|m| m.writer == Writer::Maya) && lines.len() == 1, "{lines:?}");
        let opacity: Vec<_> = found.iter().map(|m| m.opacity().unwrap().x).collect();
        assert_eq!(opacity, [1.0, 0.2, 0.0]);
        for other in ["d 1\n", "newmtl b\nillum 2\n", "newmtl b\nillum 4\nNi 1.5\n"] {
            assert_eq!(read(&format!("{maya}{other}")).0[0].writer, Writer::Unknown, "{other}");
        }
    }

    #[test]
    fn a_whole_tr_of_what_is_no_glass_is_opacity() {
        let (found, lines) = read("newmtl a\nTr 1.0\nillum 1\nnewmtl b\nTr 0.25\nillum 1\n");
        assert_eq!(found.iter().map(|m| m.opacity().unwrap().x).collect::<Vec<_>>(), [1.0, 0.25]);
        assert!(lines.len() == 1 && lines[0].contains("'Tr' 1"), "{lines:?}");
        // Where others have none, it is what it says.
        let (found, lines) = read("newmtl a\nTr 0\nillum 2\nnewmtl b\nTr 0.75\nillum 2\nnewmtl c\nd 0.5\nTr 1\n");
        assert_eq!(found.iter().map(|m| m.opacity().unwrap().x).collect::<Vec<_>>(), [1.0, 0.25, 0.5]);
        assert!(lines.is_empty(), "{lines:?}");
    }

    #[test]
    fn blender_signs_its_files() {
        for head in
            ["# Blender MTL File: 'a.blend'", "# Blender3D MTL File: a.blend", "# Blender 4.2.0 MTL File: 'a.blend'"]
        {
            assert_eq!(read(&format!("{head}\n\nnewmtl a\n")).0[0].writer, Writer::Blender);
        }
        assert_eq!(read("newmtl a\n# Blender\nKd 1 1 1\n").0[0].writer, Writer::Unknown);
    }
}
