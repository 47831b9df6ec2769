//! Glare in pictures, against `evalglare` of Radiance.

use glam::DVec3;
use ltm::LinearImage;
use ltm::daylight::{GlareOptions, SeenGlare, SeenPoint, points_of_picture, position_index};

/// A disc in a picture: degrees to the right and up, radius in degrees, cd/m².
type Disc = ([f64; 2], f64, f64);

fn direction([right, up]: [f64; 2]) -> DVec3 {
    let ((across, ahead), (up, ring)) = (right.to_radians().sin_cos(), up.to_radians().sin_cos());
    DVec3::new(across * ring, up, ahead * ring)
}

/// A picture of even luminance with discs, of which the later cover the earlier ones, by the direction of each pixel.
fn picture(
    (width, height): (u32, u32),
    even: f64,
    discs: &[Disc],
    at: impl Fn(f64, f64) -> Option<DVec3>,
) -> LinearImage {
    let luminance = |x: u32, y: u32| {
        let (x, y) =
            ((f64::from(x) + 0.5) / f64::from(width) * 2.0 - 1.0, 1.0 - (f64::from(y) + 0.5) / f64::from(height) * 2.0);
        let Some(towards) = at(x, y) else { return 0.0 };
        let covers = |disc: &&Disc| towards.dot(direction(disc.0)) >= disc.1.to_radians().cos();
        discs.iter().rfind(covers).map_or(even, |disc| disc.2)
    };
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let pixels = pixels.map(|(x, y)| [(luminance(x, y) / 179.0) as f32; 3]).collect();
    LinearImage { width, height, pixels }
}

fn fisheye(even: f64, discs: &[Disc]) -> LinearImage {
    picture((512, 512), even, discs, |x, y| {
        let from_middle = x.hypot(y);
        let (sine, cosine) = (from_middle * std::f64::consts::FRAC_PI_2).sin_cos();
        (from_middle <= 1.0).then(|| DVec3::new(x * sine / from_middle, y * sine / from_middle, cosine))
    })
}

fn panorama(even: f64, discs: &[Disc]) -> LinearImage {
    picture((1024, 512), even, discs, |x, y| Some(direction([180.0 * x, 90.0 * y])))
}

fn seen(picture: &LinearImage, turn: [f64; 2]) -> SeenGlare {
    SeenGlare::of_points(&points_of_picture("a", picture, turn).unwrap(), GlareOptions::default()).unwrap()
}

/// Luminance beside the discs, discs, DGP, lux at the eye, and luminance, solid angle and position index of each source.
type Reference = (f64, &'static [Disc], f64, f64, &'static [(f64, f64, f64)]);

const EVEN: f64 = 359.398437;

/// What `evalglare -d` of Radiance (pyradiance 1.3.1) says of the same fisheyes of 512 × 512 pixels.
const EVALGLARE: [Reference; 8] = [
    (EVEN, &[], 0.225277, 1129.085810, &[]),
    (EVEN, &[([20.0, 15.0], 10.0, 5750.375)], 0.279259, 1591.884702, &[(5750.375, 0.0953024, 1.841317)]),
    (
        2.0 * EVEN,
        &[([40.0, 10.0], 8.0, 11500.75), ([-35.0, 25.0], 6.0, 23001.5)],
        0.376293,
        3320.665303,
        &[(11500.75, 0.0611555, 2.375396), (23001.5, 0.0343935, 3.541720)],
    ),
    (
        2.0 * EVEN,
        &[([10.0, 20.0], 4.0, 11500.75), ([22.0, 20.0], 4.0, 11500.75)],
        0.321742,
        2555.887160,
        &[(11500.75, 0.0307824, 2.148087)],
    ),
    (
        2.0 * EVEN,
        &[([30.0, 20.0], 12.0, 5750.375), ([30.0, 20.0], 1.0, 184012.0)],
        0.370958,
        2947.539387,
        &[(184012.0, 0.00091719, 2.654370), (5750.375, 0.1364695, 2.602860)],
    ),
    (0.25 * EVEN, &[([30.0, 10.0], 3.0, 2875.1875)], 0.191650, 302.809880, &[(2875.1875, 0.00865636, 1.906906)]),
    (EVEN, &[([0.0, 0.0], 8.0, 11500.75)], 0.345968, 1809.206139, &[(11500.75, 0.0613442, 1.001755)]),
    (2.0 * EVEN, &[([70.0, 5.0], 10.0, 23001.5)], 0.352435, 2976.716320, &[(23001.5, 0.0954195, 5.196152)]),
];

/// Its constants are 0.092 and 0.159 where those of the paper, and here, are 0.0918 and 0.16: by them its DGP is lower by 0.001 less 0.0002 log₁₀ of a number
/// that is below 10 in these pictures.
#[test]
fn fisheyes_have_the_glare_that_evalglare_says() {
    for (even, discs, probability, eye_lux, sources) in EVALGLARE {
        let glare = seen(&fisheye(even, discs), [0.0; 2]);
        let higher = glare.probability - probability;
        assert!((0.0007..0.00105).contains(&higher), "{discs:?}: {} for {probability}", glare.probability);
        assert!((glare.eye_lux / eye_lux - 1.0).abs() < 1e-3, "{discs:?}: {} for {eye_lux}", glare.eye_lux);
        assert_eq!(glare.sources.len(), sources.len(), "{discs:?}: {:?}", glare.sources);
        for (found, (luminance, solid_angle, index)) in glare.sources.iter().zip(sources) {
            assert!((found.luminance / luminance - 1.0).abs() < 1e-4, "{discs:?}: {found:?}");
            assert!((found.solid_angle / solid_angle - 1.0).abs() < 2e-3, "{discs:?}: {found:?}");
            assert!((found.position_index / index - 1.0).abs() < 2e-3, "{discs:?}: {found:?}");
        }
    }
}

/// The same field of view in a panorama, also one that the eye turns to, is the same glare but for the sizes of pixels.
#[test]
fn a_panorama_has_the_glare_of_a_fisheye() {
    let disc = ([20.0, 15.0], 10.0, 5750.375);
    let wanted = seen(&fisheye(EVEN, &[disc]), [0.0; 2]);
    // Behind the eye is what it does not see.
    let behind = ([170.0, 10.0], 20.0, 20000.0);
    let ahead = seen(&panorama(EVEN, &[disc, behind]), [0.0; 2]);
    let turned = seen(&panorama(EVEN, &[([-70.0, 15.0], 10.0, 5750.375)]), [-90.0, 0.0]);
    for found in [ahead, turned] {
        assert!((found.probability - wanted.probability).abs() < 5e-4, "{found:?} for {wanted:?}");
        assert!((found.eye_lux / wanted.eye_lux - 1.0).abs() < 2e-3, "{found:?} for {wanted:?}");
    }
    let up = seen(&panorama(EVEN, &[([0.0, 40.0], 5.0, 5750.375)]), [0.0, 40.0]);
    assert!((up.sources[0].direction - DVec3::Z).length() < 1e-3, "{up:?}");
}

/// Iwata and Tokura below the line of sight: 1 + 0.8 R / D up to R = 0.6 D, 1 + 1.2 R / D beyond. Guth's index is 1 ahead and 16 at most.
#[test]
fn the_position_index_is_that_of_its_equations() {
    for (right, down, wanted) in [(0.3, 0.4, 1.4), (0.0, 0.5, 1.4), (0.6, 0.8, 2.2), (0.0, 2.0, 3.4), (0.0, 40.0, 16.0)]
    {
        let found = position_index(DVec3::new(right, -down, 1.0).normalize());
        assert!((found - wanted).abs() < 1e-9, "{right} {down}: {found} for {wanted}");
    }
    assert!((position_index(DVec3::Z) - 1.0).abs() < 1e-9);
    // By hand, 45° straight up: exp(33.98 · 0.045 + 21 · 0.02025).
    let found = position_index(DVec3::new(0.0, 1.0, 1.0).normalize());
    assert!((found - (33.98f64 * 0.045 + 21.0 * 0.02025).exp()).abs() < 1e-6, "{found}");
}

#[test]
fn pictures_that_show_no_eyes_view_are_told_in_a_line() {
    let of = |size: (u32, u32), value: f32, turn: [f64; 2]| {
        let pixels = vec![[value; 3]; (size.0 * size.1) as usize];
        points_of_picture("a.exr", &LinearImage { width: size.0, height: size.1, pixels }, turn)
            .unwrap_err()
            .to_string()
    };
    assert!(of((30, 20), 1.0, [0.0; 2]).contains("a.exr: has 30 × 20 pixels, and is neither a fisheye nor a panorama"));
    assert!(of((8, 8), 1.0, [10.0, 0.0]).contains("a.exr: is a fisheye, in which an eye cannot turn"));
    assert!(of((8, 8), f32::NAN, [0.0; 2]).contains("a.exr: has values that are not finite"));
    assert!(of((4098, 1), 1.0, [0.0; 2]).contains("a.exr: has 4098 × 1 pixels"));
    let point = SeenPoint { direction: DVec3::Z, luminance: 1.0, solid_angle: 1.0 };
    let options = GlareOptions { threshold: -1.0, ..GlareOptions::default() };
    let problem = SeenGlare::of_points(&[point], options).unwrap_err().to_string();
    assert!(problem.contains("the threshold -1 is not above 0"), "{problem}");
    let dark = SeenGlare::of_points(&[], GlareOptions::default()).unwrap();
    assert_eq!((dark.probability, dark.eye_lux, dark.sources.len()), (0.16, 0.0, 0));
}
