//! The metadata of a container: the job, the report and, where they are known, the errors of single lights, of denoising and
//! of exposed images, compressed together.

use super::format::u32_at;
use super::report::ContainerReport;
use crate::encoding::{decode as decode_record, encode as encode_record};
use crate::light::{DenoiseErrors, ExposedError, Job, LightErrors, StatedErrors, decode_job, encode_job};

/// What any metadata may unpack to, and what each of its bytes on disk earns on top of that.
const FREE_BYTES: usize = 1 << 16;
const EARNED_PER_BYTE: usize = 256;

/// From so many bytes on, those of some thousand lights, the strongest compression would take seconds for each million.
const LARGE_BYTES: usize = 1 << 20;

/// Encodes job and report: two lengths, a flag, and their bytes, zstd-compressed unless that would look like a bomb.
pub(super) fn encode(job: &Job, report: &ContainerReport, errors: &StatedErrors) -> Vec<u8> {
    let job = encode_job(job);
    let mut report = encode_record(report);
    if let Some(lights) = &errors.lights {
        report.extend(encode_record(lights));
        // The errors of exposed images stand behind those of denoising, which are no numbers where nothing was denoised.
        let cleaning = errors.cleaning.or(errors.exposed.map(|_| DenoiseErrors::NONE));
        cleaning.iter().for_each(|cleaning| report.extend(encode_record(cleaning)));
        errors.exposed.iter().for_each(|exposed| report.extend(encode_record(exposed)));
    }
    let plain = [job.as_slice(), report.as_slice()].concat();
    let packed = zstd::bulk::compress(&plain, if plain.len() < LARGE_BYTES { 19 } else { 9 })
        .expect("compressing into memory cannot fail");
    let compressed = packed.len() < plain.len() && plain.len() <= allowed(packed.len());
    let mut bytes = Vec::new();
    bytes.extend((job.len() as u32).to_le_bytes());
    bytes.extend((report.len() as u32).to_le_bytes());
    bytes.extend(u32::from(compressed).to_le_bytes());
    bytes.extend(if compressed { packed } else { plain });
    bytes
}

/// Decodes job and report, refusing lengths that the bytes have not earned.
pub(super) fn decode(bytes: &[u8]) -> Result<(Job, ContainerReport, StatedErrors), String> {
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
    let (report, used): (ContainerReport, usize) =
        decode_record(&plain[job_bytes..]).map_err(|e| format!("the report does not decode ({e})"))?;
    let rest = &plain[job_bytes + used..];
    if rest.is_empty() {
        return Ok((job, report, StatedErrors::default()));
    }
    let (lights, used): (LightErrors, usize) =
        decode_record(rest).map_err(|e| format!("the errors of lights do not decode ({e})"))?;
    let mut rest = &rest[used..];
    let mut cleaning = None;
    if !rest.is_empty() {
        let (errors, used): (DenoiseErrors, usize) =
            decode_record(rest).map_err(|e| format!("the errors of cleaning do not decode ({e})"))?;
        (cleaning, rest) = (Some(errors).filter(|errors| !errors.is_none()), &rest[used..]);
    }
    let mut exposed = None;
    if !rest.is_empty() {
        let (error, used): (ExposedError, usize) =
            decode_record(rest).map_err(|e| format!("the error of exposed images does not decode ({e})"))?;
        (exposed, rest) = (Some(error), &rest[used..]);
    }
    if !rest.is_empty() {
        return Err(format!("the report has {} trailing bytes", rest.len()));
    }
    if lights.worst_column as usize >= job.shape.columns() {
        return Err(format!("the errors of lights name column {}, beyond the last", lights.worst_column));
    }
    Ok((job, report, StatedErrors { lights: Some(lights), cleaning, exposed }))
}

fn allowed(packed_bytes: usize) -> usize {
    FREE_BYTES + EARNED_PER_BYTE * packed_bytes
}
