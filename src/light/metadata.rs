//! The bytes of a [`Job`], as tagged sections and in the form of earlier versions of the files: a `JobRecord`, after it the
//! weights of the scene's lighting that are not their lights' emission, if there are any, then the scales of columns, if they
//! are known.

use sha2::{Digest, Sha256};

use super::job::JobHash;
use super::{Job, Light, LightBasis, Provenance};
use crate::encoding::{Decode, Encode, MAX_BYTES, decode, encode};
use crate::error::Result;
use crate::matrix::MatrixShape;
use crate::sections::{Sections, Tag, append};

/// The section of the job's record.
const DESCRIPTION: Tag = Tag(*b"Desc");
/// The section of the scene's own weights. Readers must know it: without it the scene would be lit by its lights' emission.
const SCENE_WEIGHTS: Tag = Tag(*b"Wght");
/// The section of the columns' scales. Readers must know it: without it columns would be as bright as they were compared.
const COLUMN_SCALES: Tag = Tag(*b"Scal");
/// All sections of a job.
pub(crate) const JOB_SECTIONS: [Tag; 3] = [DESCRIPTION, SCENE_WEIGHTS, COLUMN_SCALES];

#[derive(Encode, Decode)]
struct JobRecord {
    width: u32,
    height: u32,
    columns: u32,
    block_side: u32,
    lights: Vec<Light>,
    provenance: Provenance,
}

impl JobRecord {
    fn of(job: &Job) -> Self {
        Self {
            width: job.shape.width(),
            height: job.shape.height(),
            columns: job.shape.columns() as u32,
            block_side: job.shape.block_side(),
            lights: job.basis.lights().to_vec(),
            provenance: job.provenance.clone(),
        }
    }
}

/// First column and weights of each light that the scene lights texel by texel.
type SceneWeights = Vec<(u32, Vec<[f32; 3]>)>;

/// Encodes a job as tagged sections.
pub fn encode_job(job: &Job) -> Vec<u8> {
    let mut bytes = Vec::new();
    append(&mut bytes, DESCRIPTION, &encode(JobRecord::of(job)));
    let (weights, scales) = (job.basis.own_scene_weights(), job.basis.column_scales());
    if !weights.is_empty() {
        append(&mut bytes, SCENE_WEIGHTS, &encode(weights));
    }
    if !scales.is_empty() {
        append(&mut bytes, COLUMN_SCALES, &encode(scales));
    }
    bytes
}

/// Decodes a job from tagged sections.
///
/// # Errors
/// As text for the caller to place: sections that do not hold together or do not decode, parts that do not fit each other.
pub fn decode_job(bytes: &[u8]) -> Result<Job, String> {
    job_of(&Sections::split(bytes, &JOB_SECTIONS)?)
}

/// The job that some sections describe.
///
/// # Errors
/// As those of [`decode_job`].
pub(crate) fn job_of(sections: &Sections<'_>) -> Result<Job, String> {
    let description = sections.body(DESCRIPTION).ok_or("the job description is missing")?;
    let record = decode_whole(description)?;
    let weights: SceneWeights = sections.body(SCENE_WEIGHTS).map_or_else(|| Ok(Vec::new()), decode_whole)?;
    let scales: Vec<f32> = sections.body(COLUMN_SCALES).map_or_else(|| Ok(Vec::new()), decode_whole)?;
    assembled(record, weights, scales)
}

/// A record that fills the body of its section.
fn decode_whole<T: Decode<()>>(body: &[u8]) -> Result<T, String> {
    let (record, used) = decode_some(body)?;
    match body.len() - used {
        0 => Ok(record),
        rest => Err(trailing(rest)),
    }
}

/// A record at the start of some bytes, and how many it took.
fn decode_some<T: Decode<()>>(bytes: &[u8]) -> Result<(T, usize), String> {
    if bytes.len() > MAX_BYTES {
        return Err(format!("the job description has {} bytes, more than {MAX_BYTES}", bytes.len()));
    }
    decode(bytes).map_err(|e| format!("the job description does not decode ({e})"))
}

fn trailing(bytes: usize) -> String {
    format!("the job description has {bytes} trailing bytes")
}

/// What tells a job from others: all but the scales of its columns, which are measured and follow from the rest. Identities are
/// hashed from these bytes, in the form of the first version, whatever form a file has.
pub(super) fn encode_description(job: &Job) -> Vec<u8> {
    let mut bytes = encode(JobRecord::of(job));
    let weights = job.basis.own_scene_weights();
    if !weights.is_empty() {
        bytes.extend(encode(weights));
    }
    bytes
}

/// Decodes a job of a file from before tagged sections: version 1 of containers, versions 1 to 3 of stored matrices.
///
/// # Errors
/// As text for the caller to place: anything that does not decode, trailing bytes, or parts that do not fit each other.
pub(crate) fn decode_positional_job(bytes: &[u8]) -> Result<Job, String> {
    let (record, used): (JobRecord, usize) = decode_some(bytes)?;
    let rest = &bytes[used..];
    let (weights, used): (SceneWeights, usize) = if rest.is_empty() { Default::default() } else { decode_some(rest)? };
    let rest_of_weights = &rest[used..];
    let (scales, used): (Vec<f32>, usize) =
        if rest_of_weights.is_empty() { Default::default() } else { decode_some(rest_of_weights)? };
    // An empty list is written only where a list follows: a description has one form.
    let last_is_empty = if rest_of_weights.is_empty() { weights.is_empty() } else { scales.is_empty() };
    if used != rest_of_weights.len() || (last_is_empty && !rest.is_empty()) {
        return Err(trailing(rest.len()));
    }
    assembled(record, weights, scales)
}

/// A job of its parts.
fn assembled(record: JobRecord, weights: SceneWeights, scales: Vec<f32>) -> Result<Job, String> {
    let shape = MatrixShape::new(record.width, record.height, record.columns, record.block_side)
        .map_err(|e| format!("the job description is impossible: {e}"))?;
    let mut basis = LightBasis::new();
    for light in record.lights {
        basis.push(light).map_err(|e| format!("the job description is impossible: {e}"))?;
    }
    if !weights.is_sorted_by(|a, b| a.0 < b.0) {
        return Err("the job's scene weights are not in order".into());
    }
    for (first_column, weights) in weights {
        basis
            .set_scene_weights(first_column, weights)
            .map_err(|e| format!("the job description is impossible: {e}"))?;
    }
    basis.set_column_scales(scales).map_err(|e| format!("the job description is impossible: {e}"))?;
    if basis.column_count() != shape.columns() {
        return Err(format!("the job has {} columns but its lights {}", shape.columns(), basis.column_count()));
    }
    Ok(Job { shape, basis, provenance: record.provenance })
}

impl Job {
    /// Identity of the job.
    pub fn hash(&self) -> JobHash {
        JobHash(Sha256::digest(encode_description(self)).into())
    }
}

#[cfg(test)]
mod tests {
    use super::super::{LightKind, LightUnit};
    use super::*;
    use crate::encoding::MEMORY_PER_BYTE;

    fn job() -> Job {
        let mut basis = LightBasis::new();
        let light = |name: &str, kind, columns| Light {
            name: name.into(),
            kind,
            unit: LightUnit::Radiance,
            emission: [1.0, 2.0, 3.0],
            first_column: 0,
            places: vec![[1.0, 2.0, 3.0]; columns],
            extents: vec![0.5; columns],
        };
        basis.push(light("lamp", LightKind::Lamp, 1)).unwrap();
        basis.push(light("panel", LightKind::AreaTexels { across: 2, down: 3 }, 6)).unwrap();
        let provenance =
            Provenance { source: "test".into(), samples_per_pixel: 16, seed: 1 << 40, ..Default::default() };
        Job { shape: MatrixShape::new(40, 30, 7, 16).unwrap(), basis, provenance }
    }

    /// The job with weights of its scene and scales of its columns.
    fn full_job() -> Job {
        let mut full = job();
        full.basis.set_scene_weights(1, (0..6).map(|i| [i as f32; 3]).collect()).unwrap();
        full.basis.set_column_scales([vec![1e-6], vec![3.0; 6]].concat()).unwrap();
        full
    }

    /// The bytes that programs wrote before tagged sections.
    fn positional(job: &Job) -> Vec<u8> {
        let mut bytes = encode_description(job);
        let scales = job.basis.column_scales();
        if !scales.is_empty() {
            if job.basis.own_scene_weights().is_empty() {
                bytes.extend(encode(job.basis.own_scene_weights()));
            }
            bytes.extend(encode(scales));
        }
        bytes
    }

    /// The same job with and without weights and scales.
    fn variants() -> [Job; 4] {
        let (mut weighted, mut scaled) = (job(), job());
        weighted.basis.set_scene_weights(1, vec![[2.0; 3]; 6]).unwrap();
        scaled.basis.set_column_scales(vec![2.0; 7]).unwrap();
        [job(), weighted, scaled, full_job()]
    }

    #[test]
    fn a_job_survives_its_bytes_in_both_forms() {
        for job in variants() {
            assert_eq!(decode_job(&encode_job(&job)).unwrap(), job);
            assert_eq!(decode_positional_job(&positional(&job)).unwrap(), job);
        }
    }

    #[test]
    fn sections_are_there_only_where_they_say_something() {
        let tags = |job: &Job| {
            let bytes = encode_job(job);
            let sections = Sections::split(&bytes, &JOB_SECTIONS).unwrap();
            JOB_SECTIONS.map(|tag| sections.body(tag).is_some())
        };
        let wanted = [[true, false, false], [true, true, false], [true, false, true], [true; 3]];
        assert_eq!(variants().each_ref().map(tags), wanted);
        assert!(decode_job(&[]).unwrap_err().contains("is missing"));
    }

    #[test]
    fn sections_in_any_order_and_with_unknown_ones_between_are_read() {
        let (full, bytes) = (full_job(), encode_job(&full_job()));
        let sections = Sections::split(&bytes, &JOB_SECTIONS).unwrap();
        let mut turned = Vec::new();
        for tag in [COLUMN_SCALES, SCENE_WEIGHTS, DESCRIPTION] {
            append(&mut turned, Tag([b'x', tag.0[1], tag.0[2], tag.0[3]]), &[7; 9]);
            append(&mut turned, tag, sections.body(tag).unwrap());
        }
        assert_eq!(decode_job(&turned).unwrap(), full);
    }

    #[test]
    fn scales_of_columns_are_no_part_of_the_identity_and_have_to_be_possible() {
        let [plain, weighted, scaled, _] = variants();
        assert_eq!(scaled.hash(), plain.hash());
        assert_ne!(weighted.hash(), plain.hash());
        for scales in
            [vec![1.0; 6], vec![0.0; 7], vec![f32::NAN; 7], vec![-1.0; 7], vec![1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0]]
        {
            let mut bytes = encode_job(&job());
            append(&mut bytes, COLUMN_SCALES, &encode(&scales));
            assert!(decode_job(&bytes).is_err());
            assert!(job().basis.set_column_scales(scales).is_err());
        }
    }

    #[test]
    fn every_truncation_is_an_error_and_no_flipped_byte_panics() {
        let (full, plain) = (encode_job(&full_job()), encode_job(&job()).len());
        // What is cut off behind a section leaves another job, which checksums and the file's shape tell apart.
        let whole = [plain, plain + 8 + encode(full_job().basis.own_scene_weights()).len()];
        for length in (0..full.len()).filter(|length| !whole.contains(length)) {
            assert!(decode_job(&full[..length]).is_err(), "{length}");
        }
        for at in 0..full.len() {
            let mut flipped = full.clone();
            flipped[at] ^= 0xff;
            let _ = decode_job(&flipped);
        }
        let old = positional(&full_job());
        for length in (0..old.len()).filter(|length| ![plain - 8, whole[1] - 16].contains(length)) {
            assert!(decode_positional_job(&old[..length]).is_err(), "{length}");
        }
        for at in 0..old.len() {
            let mut flipped = old.clone();
            flipped[at] ^= 0xff;
            let _ = decode_positional_job(&flipped);
        }
        assert!(decode_positional_job(&[positional(&job()), vec![0]].concat()).is_err());
        let longer = [encode(JobRecord::of(&job())), vec![0]].concat();
        let mut bytes = Vec::new();
        append(&mut bytes, DESCRIPTION, &longer);
        assert!(decode_job(&bytes).unwrap_err().contains("1 trailing bytes"));
    }

    /// The fields of each record and the variants of each kind, in order, are on disks: they never change.
    #[test]
    fn the_bytes_of_a_job_never_change() {
        let light = |kind, unit| Light {
            name: "ab".into(),
            kind,
            unit,
            emission: [1.0, 2.0, 4.0],
            first_column: 3,
            places: vec![[0.5, 0.25, 0.125]],
            extents: vec![8.0],
        };
        let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
        let kinds: [(LightKind, &[u8]); 11] = [
            (LightKind::Lamp, &[0]),
            (LightKind::AreaTexels { across: 20, down: 15 }, &[1, 20, 15]),
            (LightKind::LatLong { across: 20, down: 15 }, &[2, 20, 15]),
            (LightKind::Octahedral { side: 20 }, &[3, 20]),
            (LightKind::Point, &[4]),
            (LightKind::Spot, &[5]),
            (LightKind::Sun, &[6]),
            (LightKind::Ies, &[7]),
            (LightKind::Image, &[8]),
            (LightKind::Patches { subdivision: 4, is_split: true }, &[9, 4, 1]),
            (LightKind::Suns { count: 20 }, &[10, 20]),
        ];
        let units = [LightUnit::Radiance, LightUnit::Intensity, LightUnit::Irradiance, LightUnit::Multiple];
        for (kind, kind_bytes) in kinds {
            for (unit, unit_byte) in units.into_iter().zip(0..) {
                let rest = [&floats(&[1.0, 2.0, 4.0])[..], &[3, 1], &floats(&[0.5, 0.25, 0.125]), &[1]].concat();
                let bytes = [&[2, b'a', b'b'], kind_bytes, &[unit_byte], &rest, &floats(&[8.0])].concat();
                assert_eq!(encode(light(kind, unit)), bytes, "{kind:?}, {unit:?}");
                assert_eq!(decode::<Light>(&bytes).unwrap(), (light(kind, unit), bytes.len()));
            }
        }
        let record = JobRecord {
            width: 1,
            height: 2,
            columns: 3,
            block_side: 4,
            lights: vec![],
            provenance: Provenance {
                source: "s".into(),
                content: [9; 32],
                program: "p".into(),
                samples_per_pixel: 5,
                seed: 6,
                settings: "t".into(),
                metres_per_unit: 0.5,
            },
        };
        let head = [1, 2, 3, 4, 0, 1, b's'];
        let bytes = [&head, &[9; 32][..], &[1, b'p', 5, 6, 1, b't'], &floats(&[0.5])].concat();
        assert_eq!(encode(record), bytes);
        assert_eq!(JOB_SECTIONS.map(|tag| tag.0), [*b"Desc", *b"Wght", *b"Scal"]);
    }

    #[test]
    fn a_light_in_memory_is_no_larger_than_the_bound_says() {
        let bare = Light {
            name: String::new(),
            kind: LightKind::Lamp,
            unit: LightUnit::Radiance,
            emission: [0.0; 3],
            first_column: 0,
            places: vec![],
            extents: vec![],
        };
        let bytes = encode(&bare).len();
        assert!(size_of::<Light>() <= bytes * MEMORY_PER_BYTE, "{} for {bytes}", size_of::<Light>());
    }

    #[test]
    fn jobs_of_every_size_decode_and_a_length_cannot_ask_for_more_than_the_bytes_earn() {
        for columns in [1, 100, 5_000, 100_000] {
            let mut basis = LightBasis::new();
            for i in 0..columns {
                let name = i.to_string();
                let (kind, unit) = (LightKind::Lamp, LightUnit::Radiance);
                let (emission, places, extents) = ([1.0; 3], vec![[0.0; 3]], vec![0.0]);
                // Pushing looks every name up: too slow for more.
                if columns <= 5_000 {
                    basis.push(Light { name, kind, unit, emission, first_column: 0, places, extents }).unwrap();
                }
            }
            if columns > 5_000 {
                let (kind, unit) = (LightKind::LatLong { across: columns, down: 1 }, LightUnit::Radiance);
                let (places, extents) = (vec![[0.0; 3]; columns as usize], vec![0.0; columns as usize]);
                let emission = [1.0; 3];
                basis
                    .push(Light { name: "sky".into(), kind, unit, emission, first_column: 0, places, extents })
                    .unwrap();
            }
            let shape = MatrixShape::new(4, 4, columns, 4).unwrap();
            let job = Job { shape, basis, provenance: Provenance::default() };
            assert_eq!(decode_job(&encode_job(&job)).unwrap(), job, "{columns} columns");
        }
        // Shape, then a number of lights that would take gigabytes: 2²⁴.
        let absurd = [4, 4, 1, 4, 252, 0, 0, 0, 1, 0];
        let mut section = Vec::new();
        append(&mut section, DESCRIPTION, &absurd);
        for problem in [decode_positional_job(&absurd).unwrap_err(), decode_job(&section).unwrap_err()] {
            assert!(problem.contains("LimitExceeded"), "{problem}");
        }
    }

    #[test]
    fn the_hash_tells_jobs_apart() {
        let mut other = job();
        other.provenance.seed += 1;
        assert_ne!(job().hash(), other.hash());
        assert_eq!(job().hash(), job().hash());
    }
}
