//! The metadata of a container: the job, the report and, where it is known, what single lights lose, compressed together.

use super::format::u32_at;
use super::report::ContainerReport;
use crate::light::{Job, LightErrors, decode_job, encode_job};

/// What any metadata may unpack to, and what each of its bytes on disk earns on top of that.
const FREE_BYTES: usize = 1 << 16;
const EARNED_PER_BYTE: usize = 256;
/// Bound on the decoded report, so that no length field in it can ask for more.
const MAX_REPORT_BYTES: usize = 1 << 24;

/// Encodes job and report: two lengths, a flag, and their bytes, zstd-compressed unless that would look like a bomb.
pub(super) fn encode(job: &Job, report: &ContainerReport, lights: Option<&LightErrors>) -> Vec<u8> {
    let job = encode_job(job);
    let mut report = bincode::encode_to_vec(report, config()).expect("encoding into memory cannot fail");
    if let Some(lights) = lights {
        report.extend(bincode::encode_to_vec(lights, config()).expect("encoding into memory cannot fail"));
    }
    let plain = [job.as_slice(), report.as_slice()].concat();
    let packed = zstd::bulk::compress(&plain, 19).expect("compressing into memory cannot fail");
    let compressed = packed.len() < plain.len() && plain.len() <= allowed(packed.len());
    let mut bytes = Vec::new();
    bytes.extend((job.len() as u32).to_le_bytes());
    bytes.extend((report.len() as u32).to_le_bytes());
    bytes.extend(u32::from(compressed).to_le_bytes());
    bytes.extend(if compressed { packed } else { plain });
    bytes
}

/// Decodes job and report, refusing lengths that the bytes have not earned.
pub(super) fn decode(bytes: &[u8]) -> Result<(Job, ContainerReport, Option<LightErrors>), String> {
    let Some(body) = bytes.get(12..) else {
        return Err("the metadata is cut short".into());
    };
    let (job_bytes, report_bytes) = (u32_at(bytes, 0) as usize, u32_at(bytes, 4) as usize);
    let plain_bytes = job_bytes + report_bytes;
    let unpacked;
    let plain = match u32_at(bytes, 8) {
        0 => body,
        1 if plain_bytes <= allowed(body.len()) => {
            unpacked = zstd::bulk::decompress(body, plain_bytes)
                .map_err(|e| format!("the metadata does not decompress ({e})"))?;
            &unpacked
        }
        1 => return Err("the metadata claims more than its bytes can hold".into()),
        flag => return Err(format!("the metadata is compressed in an unknown way ({flag})")),
    };
    if plain.len() != plain_bytes {
        return Err("the metadata's lengths do not fit each other".into());
    }
    let job = decode_job(&plain[..job_bytes])?;
    let (report, used): (ContainerReport, usize) = bincode::decode_from_slice(&plain[job_bytes..], config())
        .map_err(|e| format!("the report does not decode ({e})"))?;
    let rest = &plain[job_bytes + used..];
    if rest.is_empty() {
        return Ok((job, report, None));
    }
    let (lights, used): (LightErrors, usize) =
        bincode::decode_from_slice(rest, config()).map_err(|e| format!("the errors of lights do not decode ({e})"))?;
    if used != rest.len() {
        return Err(format!("the report has {} trailing bytes", rest.len() - used));
    }
    if lights.worst_column as usize >= job.shape.columns() {
        return Err(format!("the errors of lights name column {}, beyond the last", lights.worst_column));
    }
    Ok((job, report, Some(lights)))
}

fn config() -> impl bincode::config::Config {
    bincode::config::standard().with_limit::<MAX_REPORT_BYTES>()
}

fn allowed(packed_bytes: usize) -> usize {
    FREE_BYTES + EARNED_PER_BYTE * packed_bytes
}
