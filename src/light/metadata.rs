//! The bytes of a [`Job`]: the only place that knows bincode.
//!
//! Layout: bincode 2, little-endian, variable-length integers, the fields of `JobRecord` in order; `formats/` writes
//! it down. A checksum is the containing file's business.

use super::{Job, Light, LightBasis, Provenance};
use crate::error::Result;
use crate::matrix::MatrixShape;

/// Bound on decoded metadata, so that no length field can ask for more memory than this.
const MAX_BYTES: usize = 1 << 30;

#[derive(bincode::Encode, bincode::Decode)]
struct JobRecord {
    width: u32,
    height: u32,
    columns: u32,
    block_side: u32,
    lights: Vec<Light>,
    provenance: Provenance,
}

fn config() -> impl bincode::config::Config {
    bincode::config::standard().with_limit::<MAX_BYTES>()
}

/// Encodes a job.
pub fn encode_job(job: &Job) -> Vec<u8> {
    let record = JobRecord {
        width: job.shape.width(),
        height: job.shape.height(),
        columns: job.shape.columns() as u32,
        block_side: job.shape.block_side(),
        lights: job.basis.lights().to_vec(),
        provenance: job.provenance.clone(),
    };
    bincode::encode_to_vec(record, config()).expect("encoding into memory cannot fail")
}

/// Decodes a job. Errors, as plain text for the caller to place: anything that does not decode, trailing bytes, or
/// parts that do not fit each other.
pub fn decode_job(bytes: &[u8]) -> Result<Job, String> {
    let (record, used): (JobRecord, usize) = bincode::decode_from_slice(bytes, config())
        .map_err(|e| format!("the job description does not decode ({e})"))?;
    if used != bytes.len() {
        return Err(format!("the job description has {} trailing bytes", bytes.len() - used));
    }
    let shape = MatrixShape::new(record.width, record.height, record.columns, record.block_side)
        .map_err(|e| format!("the job description is impossible: {e}"))?;
    let mut basis = LightBasis::new();
    for light in record.lights {
        basis.push(light).map_err(|e| format!("the job description is impossible: {e}"))?;
    }
    if basis.column_count() != shape.columns() {
        return Err(format!("the job has {} columns but its lights {}", shape.columns(), basis.column_count()));
    }
    Ok(Job { shape, basis, provenance: record.provenance })
}

#[cfg(test)]
mod tests {
    use super::super::{LightKind, LightUnit};
    use super::*;

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
    fn the_hash_tells_jobs_apart() {
        let mut other = job();
        other.provenance.seed += 1;
        assert_ne!(job().hash(), other.hash());
        assert_eq!(job().hash(), job().hash());
    }
}
