//! The bytes of a [`Job`]: a `JobRecord`, and after it the weights of the scene's lighting that are not their lights'
//! emission, if there are any, then the scales of columns, if they are known.

use super::{Job, Light, LightBasis, Provenance};
use crate::encoding::{Decode, Encode, MAX_BYTES, decode, encode};
use crate::error::Result;
use crate::matrix::MatrixShape;

#[derive(Encode, Decode)]
struct JobRecord {
    width: u32,
    height: u32,
    columns: u32,
    block_side: u32,
    lights: Vec<Light>,
    provenance: Provenance,
}

/// First column and weights of each light that the scene lights texel by texel.
type SceneWeights = Vec<(u32, Vec<[f32; 3]>)>;

/// Encodes a job.
pub fn encode_job(job: &Job) -> Vec<u8> {
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

/// What tells a job from others: all but the scales of its columns, which are measured and follow from the rest.
pub(super) fn encode_description(job: &Job) -> Vec<u8> {
    let record = JobRecord {
        width: job.shape.width(),
        height: job.shape.height(),
        columns: job.shape.columns() as u32,
        block_side: job.shape.block_side(),
        lights: job.basis.lights().to_vec(),
        provenance: job.provenance.clone(),
    };
    let mut bytes = encode(record);
    let weights = job.basis.own_scene_weights();
    if !weights.is_empty() {
        bytes.extend(encode(weights));
    }
    bytes
}

/// Decodes a job.
///
/// # Errors
/// As text for the caller to place: anything that does not decode, trailing bytes, or parts that do not fit each other.
pub fn decode_job(bytes: &[u8]) -> Result<Job, String> {
    if bytes.len() > MAX_BYTES {
        return Err(format!("the job description has {} bytes, more than {MAX_BYTES}", bytes.len()));
    }
    let undecodable = |e: String| format!("the job description does not decode ({e})");
    let (record, used): (JobRecord, usize) = decode(bytes).map_err(undecodable)?;
    let rest = &bytes[used..];
    let (weights, used): (SceneWeights, usize) =
        if rest.is_empty() { Default::default() } else { decode(rest).map_err(undecodable)? };
    let rest_of_weights = &rest[used..];
    let (scales, used): (Vec<f32>, usize) =
        if rest_of_weights.is_empty() { Default::default() } else { decode(rest_of_weights).map_err(undecodable)? };
    // An empty list is written only where a list follows: a description has one form.
    let last_is_empty = if rest_of_weights.is_empty() { weights.is_empty() } else { scales.is_empty() };
    if used != rest_of_weights.len() || (last_is_empty && !rest.is_empty()) {
        return Err(format!("the job description has {} trailing bytes", rest.len()));
    }
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

    #[test]
    fn a_job_survives_its_bytes() {
        assert_eq!(decode_job(&encode_job(&job())).unwrap(), job());
    }

    #[test]
    fn the_scenes_own_weights_survive_and_take_no_byte_where_there_are_none() {
        let mut lit = job();
        lit.basis.set_scene_weights(1, (0..6).map(|i| [i as f32; 3]).collect()).unwrap();
        let bytes = encode_job(&lit);
        assert_eq!(decode_job(&bytes).unwrap(), lit);
        assert!(bytes.starts_with(&encode_job(&job())));
        for length in encode_job(&job()).len() + 1..bytes.len() {
            assert!(decode_job(&bytes[..length]).is_err());
        }
        assert!(decode_job(&[encode_job(&job()), vec![0]].concat()).is_err());
    }

    #[test]
    fn scales_of_columns_survive_with_and_without_weights_and_are_no_part_of_the_identity() {
        let mut scaled = job();
        scaled.basis.set_column_scales([vec![1e-6], vec![3.0; 6]].concat()).unwrap();
        assert_eq!(decode_job(&encode_job(&scaled)).unwrap(), scaled);
        assert_eq!(scaled.hash(), job().hash());
        let bytes = encode_job(&scaled);
        for length in encode_job(&job()).len() + 1..bytes.len() {
            assert!(decode_job(&bytes[..length]).is_err(), "{length} of {}", bytes.len());
        }
        scaled.basis.set_scene_weights(1, vec![[2.0; 3]; 6]).unwrap();
        assert_eq!(decode_job(&encode_job(&scaled)).unwrap(), scaled);
        for scales in
            [vec![1.0; 6], vec![0.0; 7], vec![f32::NAN; 7], vec![-1.0; 7], vec![1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0]]
        {
            assert!(scaled.basis.set_column_scales(scales).is_err());
        }
    }

    #[test]
    fn every_truncation_is_an_error_and_no_flipped_byte_panics() {
        let bytes = encode_job(&job());
        for length in 0..bytes.len() {
            assert!(decode_job(&bytes[..length]).is_err());
        }
        for at in 0..bytes.len() {
            let mut flipped = bytes.clone();
            flipped[at] ^= 0xff;
            let _ = decode_job(&flipped);
        }
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
        let problem = decode_job(&absurd).unwrap_err();
        assert!(problem.contains("LimitExceeded"), "{problem}");
    }

    #[test]
    fn the_hash_tells_jobs_apart() {
        let mut other = job();
        other.provenance.seed += 1;
        assert_ne!(job().hash(), other.hash());
        assert_eq!(job().hash(), job().hash());
    }
}
