//! The first thing that one looks at: a picture at full size under one lamp, beside a denoiser's.

use super::StudyReport;
use super::bench::{Bench, CLASSROOM, CONFERENCE_CORNER, CONFERENCE_LAMPS, CONFERENCE_PANEL, Wanted};
use super::mosaic::Picture;
use super::oidn::{self, Surfaces};
use super::reference::alone;
use super::rivals::packed;
use super::table::Table;
use super::visual_metrics::Seen;
use ltm::error::Result;
use ltm::image::LinearImage;
use ltm::light::Lighting;
use ltm::matrix::BlockSource;
use ltm::pipeline::PackOptions;
use ltm::relight::relight_raw;
use ltm::store::StoreReader;

struct Plan {
    rooms: &'static [Room],
    size: (u32, u32),
    /// Samples of the references, in each of which one lamp is all there is.
    converged: u32,
    samples: &'static [u32],
}

/// A scene of which one lamp at a time is on.
struct Room {
    scene: &'static str,
    lamps: &'static [&'static str],
    /// Texels along the sides of its lights that have any.
    texels: u32,
    /// These pictures took part in choosing constants of the denoising.
    tuned_on: bool,
}

/// Lamps on which constants of the denoiser were chosen.
const TUNED_ON: Room =
    Room { scene: CONFERENCE_LAMPS, lamps: &["lum_03", "lum_10", "lum_17"], texels: 1, tuned_on: true };

const QUICK: Plan = Plan { rooms: &[TUNED_ON], size: (64, 48), converged: 64, samples: &[16] };
const FULL: Plan = Plan {
    rooms: &[
        TUNED_ON,
        Room { scene: CONFERENCE_CORNER, lamps: &["lum_06", "lum_21"], texels: 1, tuned_on: false },
        Room { scene: CLASSROOM, lamps: &["unnamed_L001"], texels: 1, tuned_on: false },
        Room { scene: CONFERENCE_PANEL, lamps: &["panel"], texels: 32, tuned_on: true },
    ],
    size: (1024, 768),
    converged: 384,
    samples: &[16, 64],
};

const NOTE: &str = "Images under one of the lamps at a time, packed with all of them. Reference: a matrix of another seed whose scene has that \
lamp alone, so that it gets all samples. ꟻLIP and clip as `ltm study picture` has them. Denoiser: Intel's Open Image Denoise on each raw relit \
image, high quality, with the reference's albedo and normals as noise-free guides. tuned_on: the picture took part in choosing constants of \
the cleaning.";

/// A lamp, how it looks, and what its light is seen by as a denoiser wants to know it.
struct Lamp {
    name: &'static str,
    reference: LinearImage,
    surfaces: Option<Surfaces>,
}

/// One way from samples to images.
struct Rival {
    method: &'static str,
    /// One for each lamp.
    images: Vec<LinearImage>,
}

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let plan = if bench.quick { &QUICK } else { &FULL };
    let with_denoiser = oidn::OIDN.is_there();
    let absent = ["The denoiser was not measured: no Python with `pyoidn` was found."];
    let more: Vec<&str> = [NOTE].into_iter().chain(absent.into_iter().filter(|_| !with_denoiser)).collect();
    let mut table = Table::new(
        "One lamp alone at full size",
        bench.notes(&more),
        &[
            ("scene", 0),
            ("tuned_on", 0),
            ("samples_per_px", 0),
            ("reference_samples_per_px", 0),
            ("rows", 0),
            ("columns", 0),
            ("lamp", 0),
            ("method", 0),
            ("flip", 4),
            ("psnr_clip_db", 2),
            ("relative_l2", 4),
        ],
    );
    let mut report = StudyReport::default();
    let mut pictures = Vec::new();
    let rooms: Vec<&Room> = plan.rooms.iter().filter(|room| bench.has(room.scene)).collect();
    if rooms.len() < plan.rooms.len() {
        bench.watch.note("lamp: files of some scenes are not there (LTM_SCENES), these were not measured");
    }
    if rooms.is_empty() {
        return Ok(report);
    }
    let matrices = rooms.iter().map(|room| room.lamps.len() + plan.samples.len()).sum::<usize>();
    bench.watch.begin("lamp", matrices as u64, "matrices");
    for room in rooms {
        let shown = measure(bench, plan, room, with_denoiser, &mut table)?;
        pictures
            .extend(shown.into_iter().map(|(samples, picture)| (format!("lamp-{}-{samples}", room.scene), picture)));
    }
    bench.watch.end();
    report.add_table(&bench.out, "lamp", &table)?;
    for (stem, pictures) in &pictures {
        report.add_photograph(&bench.out, stem, pictures)?;
    }
    Ok(report)
}

/// The rows of one room, and its pictures under the first lamp by samples.
fn measure(
    bench: &Bench<'_>,
    plan: &Plan,
    room: &Room,
    with_denoiser: bool,
    table: &mut Table,
) -> Result<Vec<(u32, Vec<Vec<Picture>>)>> {
    let wanted =
        |texels, samples, seed| Wanted { scene: room.scene, size: plan.size, texels, samples, seed, block_side: 32 };
    let lamp = |&name: &&'static str| {
        // All texels of a light are on: one would do.
        let matrix = bench.matrix_alone(wanted(1, plan.converged, 1), name)?;
        let own = Lighting::of_scene(&matrix.job().basis);
        let mut images = relight_raw(&matrix, &[own])?;
        bench.watch.advance(1, matrix.shape().raw_bytes(), "B");
        let surfaces = Surfaces::of(&matrix)?.filter(|_| with_denoiser);
        Ok(Lamp { name, reference: images.remove(0), surfaces })
    };
    let lamps: Vec<Lamp> = room.lamps.iter().map(lamp).collect::<Result<_>>()?;
    let mut pictures = Vec::new();
    for &samples in plan.samples {
        let matrix = bench.matrix(wanted(room.texels, samples, 0))?;
        let shape = matrix.shape();
        let rivals = rivals(bench, &matrix, &lamps)?;
        let raw = rivals.last().map_or(&[][..], |raw| &raw.images);
        for rival in &rivals {
            for ((lamp, image), raw) in lamps.iter().zip(&rival.images).zip(raw) {
                let seen = Seen::of(image, &lamp.reference, raw, shape.block_side());
                table.push(vec![
                    room.scene.into(),
                    room.tuned_on.into(),
                    samples.into(),
                    plan.converged.into(),
                    shape.rows().into(),
                    shape.columns().into(),
                    lamp.name.into(),
                    rival.method.into(),
                    seen.flip.into(),
                    seen.psnr_clipped.into(),
                    seen.relative_l2.into(),
                ]);
            }
        }
        pictures.push((samples, shown(&lamps[0], samples, &rivals)));
        bench.watch.advance(1, shape.raw_bytes(), "B");
    }
    Ok(pictures)
}

/// Ours first, the raw matrix last.
fn rivals(bench: &Bench<'_>, matrix: &StoreReader, lamps: &[Lamp]) -> Result<Vec<Rival>> {
    let job = matrix.job();
    let lightings: Vec<Lighting> = lamps.iter().map(|lamp| alone(job, lamp.name)).collect::<Result<_>>()?;
    let ours = packed(
        bench,
        matrix,
        PackOptions { allow_lost_lights: true, denoise: true, ..PackOptions::default() },
        &lightings,
    )?;
    let mut rivals = vec![Rival { method: "ours", images: ours.images }];
    let raw = relight_raw(matrix, &lightings)?;
    let denoised = lamps.iter().zip(&raw).filter_map(|(lamp, raw)| Some((lamp.surfaces.as_ref()?, raw)));
    let mut images = Vec::new();
    for (surfaces, raw) in denoised {
        images.extend(oidn::denoise(std::slice::from_ref(raw), surfaces, &bench.cached("oidn"))?);
    }
    if !images.is_empty() {
        rivals.push(Rival { method: "denoiser on each image", images });
    }
    rivals.push(Rival { method: "raw matrix", images: raw });
    Ok(rivals)
}

/// The images under the first lamp, and the reference: two rows.
fn shown(lamp: &Lamp, samples: u32, rivals: &[Rival]) -> Vec<Vec<Picture>> {
    let picture = |rival: &Rival| {
        Picture::shown(&rival.images[0], &lamp.reference, format!("{}, {samples} samples", rival.method))
    };
    let mut all: Vec<Picture> = rivals.iter().map(picture).collect();
    all.push(Picture::shown(&lamp.reference, &lamp.reference, "reference"));
    all.chunks(2).map(<[Picture]>::to_vec).collect()
}
