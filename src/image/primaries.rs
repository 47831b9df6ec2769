//! Colours of other primaries and whites, brought to Rec. 709.

/// Rows of a 3 × 3 matrix.
pub(super) type ColourMatrix = [[f64; 3]; 3];

/// CIE 1931 chromaticities `[x, y]` of red, green, blue and white.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Primaries(pub(super) [[f64; 2]; 4]);

/// ITU-R BT.709: what images are computed in.
pub(super) const REC_709: Primaries = Primaries([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06], [0.3127, 0.3290]]);
/// The axes of CIE XYZ: tristimulus values, which need no white to mean a colour.
const XYZ: Primaries = Primaries([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0], [1.0 / 3.0, 1.0 / 3.0]]);

/// Colour spaces that people know by name.
const KNOWN: [(&str, Primaries); 8] = [
    ("Rec. 709", REC_709),
    ("CIE XYZ", XYZ),
    ("ACEScg", Primaries([[0.713, 0.293], [0.165, 0.830], [0.128, 0.044], [0.32168, 0.33767]])),
    ("ACES2065-1", Primaries([[0.7347, 0.2653], [0.0, 1.0], [0.0001, -0.077], [0.32168, 0.33767]])),
    ("Rec. 2020", Primaries([[0.708, 0.292], [0.170, 0.797], [0.131, 0.046], [0.3127, 0.3290]])),
    ("Display P3", Primaries([[0.680, 0.320], [0.265, 0.690], [0.150, 0.060], [0.3127, 0.3290]])),
    ("DCI-P3", Primaries([[0.680, 0.320], [0.265, 0.690], [0.150, 0.060], [0.314, 0.351]])),
    ("Adobe RGB", Primaries([[0.64, 0.33], [0.21, 0.71], [0.15, 0.06], [0.3127, 0.3290]])),
];
/// Chromaticities that differ by less are the same: they are written with three or four digits.
const SAME: f64 = 6e-4;

/// Bradford's cone responses to XYZ (Lam, *Metamerism and colour constancy*, 1985), as CIECAM97s states them.
const BRADFORD: ColourMatrix = [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]];

/// The primaries of linear light that programs name by a word: OpenColorIO's configurations and the Color Interop Forum.
pub(super) fn known(word: &str) -> Option<Primaries> {
    let name = match word.to_lowercase().as_str() {
        "acescg" | "lin_ap1_scene" | "lin_ap1" | "aces - acescg" => "ACEScg",
        "aces2065-1" | "aces2065_1" | "lin_ap0_scene" | "lin_ap0" | "aces - aces2065-1" => "ACES2065-1",
        "lin_rec2020_scene" | "lin_rec2020" | "linear rec.2020" => "Rec. 2020",
        "lin_p3d65_scene" | "lin_displayp3" | "linear p3-d65" => "Display P3",
        "lin_adobergb_scene" | "lin_adobergb" | "linear adobergb" => "Adobe RGB",
        "lin_ciexyzd65_scene" | "lin_ciexyzd65_display" | "cie-xyz-d65" => "CIE XYZ",
        "lin_rec709_scene" | "lin_rec709" | "lin_srgb" | "linear rec.709 (srgb)" => "Rec. 709",
        _ => return None,
    };
    KNOWN.iter().find(|(known, _)| *known == name).map(|(_, primaries)| *primaries)
}

impl Primaries {
    /// The name of the space, or its chromaticities.
    pub(super) fn name(&self) -> String {
        match KNOWN.iter().find(|(_, known)| self.is_near(known)) {
            Some((name, _)) => (*name).to_owned(),
            None => {
                let [red, green, blue, white] = self.0.map(|[x, y]| format!("{x:.4}, {y:.4}"));
                format!("primaries ({red}), ({green}), ({blue}) and white ({white})")
            }
        }
    }

    /// The matrix from these primaries to Rec. 709; `None` if they are Rec. 709. White is adapted by Bradford's method.
    /// Tristimulus values are not, since they are absolute colours.
    ///
    /// # Errors
    /// As text for the caller to place: numbers that span no colour space.
    pub(super) fn to_rec_709(self) -> Result<Option<ColourMatrix>, String> {
        if self.is_near(&REC_709) {
            return Ok(None);
        }
        let refused = || format!("its {} are no colour space", self.name());
        let (ours, our_white) = to_xyz(&REC_709).ok_or_else(refused)?;
        let (theirs, white) = to_xyz(&self).ok_or_else(refused)?;
        let cones = [white, our_white].map(|white| times(&BRADFORD, white));
        let scale = [0, 1, 2].map(|i: usize| cones[1][i] / cones[0][i]);
        let scaled = [0, 1, 2].map(|i: usize| BRADFORD[i].map(|v| v * scale[i]));
        let back = inverse(&BRADFORD).ok_or_else(refused)?;
        let adapt = if self.is_near(&XYZ) { IDENTITY } else { product(&back, &scaled) };
        let from_xyz = inverse(&ours).ok_or_else(refused)?;
        let whole = product(&from_xyz, &product(&adapt, &theirs));
        // Beyond this a colour of the file would be lost in the rounding of others.
        let is_sane = whole.iter().flatten().all(|v| v.is_finite() && v.abs() < 1e4);
        if is_sane { Ok(Some(whole)) } else { Err(refused()) }
    }

    /// Share of each primary in luminance.
    pub(super) fn luminance_weights(&self) -> Option<[f64; 3]> {
        to_xyz(self).map(|(matrix, _)| matrix[1]).filter(|[_, green, _]| *green > 1e-6)
    }

    fn is_near(&self, other: &Self) -> bool {
        self.0.iter().flatten().zip(other.0.iter().flatten()).all(|(a, b)| (a - b).abs() < SAME)
    }
}

/// The matrix from CIE XYZ to Rec. 709, without adaptation.
pub(super) fn xyz_to_rec_709() -> ColourMatrix {
    XYZ.to_rec_709().ok().flatten().unwrap_or(IDENTITY)
}

/// A colour under a matrix, in the precision of images.
pub(super) fn converted(matrix: &ColourMatrix, colour: [f32; 3]) -> [f32; 3] {
    times(matrix, colour.map(f64::from)).map(|v| v as f32)
}

const IDENTITY: ColourMatrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// The matrix from shares of the primaries to XYZ, white at luminance 1, and the XYZ of white (SMPTE RP 177).
fn to_xyz(primaries: &Primaries) -> Option<(ColourMatrix, [f64; 3])> {
    let [red, green, blue, white] = primaries.0.map(|[x, y]| [x, y, 1.0 - x - y]);
    if white[1].is_nan() || white[1] <= 1e-6 {
        return None;
    }
    let white = white.map(|v| v / white[1]);
    let columns = [0, 1, 2].map(|i| [red[i], green[i], blue[i]]);
    let scale = times(&inverse(&columns)?, white);
    Some((columns.map(|row| [0, 1, 2].map(|i| row[i] * scale[i])), white))
}

fn times(matrix: &ColourMatrix, vector: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2])
}

fn product(a: &ColourMatrix, b: &ColourMatrix) -> ColourMatrix {
    a.map(|row| [0, 1, 2].map(|j| row[0] * b[0][j] + row[1] * b[1][j] + row[2] * b[2][j]))
}

/// The inverse of a matrix; none where there is none, or hardly one.
pub(super) fn inverse(m: &ColourMatrix) -> Option<ColourMatrix> {
    let minor = |i: usize, j: usize| {
        let (a, b, c, d) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant = (0..3).map(|j| m[0][j] * minor(0, j)).sum::<f64>();
    let is_regular = determinant.is_finite() && determinant.abs() > 1e-9;
    is_regular.then(|| [0, 1, 2].map(|i| [0, 1, 2].map(|j| minor(j, i) / determinant)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(found: [f32; 3], wanted: [f32; 3], tolerance: f32) {
        assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < tolerance), "{found:?} for {wanted:?}");
    }

    /// The values are those of the Academy's S-2014-004 by way of Bradford's adaptation, as colour-science and OpenColorIO
    /// have them.
    #[test]
    fn acescg_becomes_rec_709_with_its_white() {
        let matrix = KNOWN[2].1.to_rec_709().unwrap().unwrap();
        near(converted(&matrix, [1.0, 0.0, 0.0]), [1.70505, -0.13026, -0.02400], 1e-4);
        near(converted(&matrix, [0.0, 1.0, 0.0]), [-0.62179, 1.14080, -0.12897], 1e-4);
        near(converted(&matrix, [1.0; 3]), [1.0; 3], 1e-6);
    }

    /// Values of IEC 61966-2-1, rounded to four digits.
    #[test]
    fn tristimulus_values_are_colours_without_a_white() {
        let matrix = xyz_to_rec_709();
        near(converted(&matrix, [0.9505, 1.0, 1.0890]), [1.0; 3], 1e-3);
        near(converted(&matrix, [1.0, 0.0, 0.0]), [3.2406, -0.9689, 0.0557], 1e-3);
    }

    #[test]
    fn rec_709_stays_and_what_spans_no_space_is_refused() {
        let written = Primaries([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06], [0.31271, 0.32902]]);
        assert_eq!((written.to_rec_709(), written.name().as_str()), (Ok(None), "Rec. 709"));
        for bad in [[[0.3, 0.3]; 4], [[0.64, 0.33], [0.3, 0.6], [0.15, 0.06], [0.3, 0.0]], [[f64::NAN; 2]; 4]] {
            assert!(Primaries(bad).to_rec_709().unwrap_err().contains("no colour space"));
        }
        let [red, green, blue] = REC_709.luminance_weights().unwrap();
        near([red as f32, green as f32, blue as f32], [0.2126, 0.7152, 0.0722], 1e-4);
    }
}
