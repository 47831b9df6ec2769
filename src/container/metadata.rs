//! The metadata of a container: the job, the report and, where they are known, the errors of single lights, of denoising and
//! of exposed images, compressed together.

use std::borrow::Cow;

use super::format::{VERSION_WITHOUT_SECTIONS, u32_at};
use super::report::ContainerReport;
use crate::encoding::{Decode, decode as decode_record, encode as encode_record};
use crate::light::{
    DenoiseErrors, DenoisedLight, JOB_SECTIONS, Job, StatedErrors, decode_positional_job, encode_job, job_of,
};
use crate::sections::{Sections, Tag, append};

/// What any metadata may unpack to, and what each of its bytes on disk earns on top of that.
const FREE_BYTES: usize = 1 << 16;
const EARNED_PER_BYTE: usize = 256;

/// From so many bytes on, those of some thousand lights, the strongest compression would take seconds for each million.
const LARGE_BYTES: usize = 1 << 20;

/// The section of the report.
const REPORT: Tag = Tag(*b"rprt");
/// The section of the errors of single lights and of all.
const LIGHT_ERRORS: Tag = Tag(*b"lerr");
/// The section of what denoising did.
const DENOISING_ERRORS: Tag = Tag(*b"derr");
/// The section of what denoising did to the picture under each light.
const DENOISED_LIGHTS: Tag = Tag(*b"dlit");
/// The section of the error of exposed images.
const EXPOSED_ERROR: Tag = Tag(*b"xerr");

/// What the metadata say.
pub(super) type Metadata = (Job, ContainerReport, StatedErrors);

/// Encodes metadata: the bytes of all sections, a flag, and the sections, zstd-compressed unless that would look like a bomb.
pub(super) fn encode(job: &Job, report: &ContainerReport, errors: &StatedErrors) -> Vec<u8> {
    let mut plain = encode_job(job);
    append(&mut plain, REPORT, &encode_record(report));
    if let Some(errors) = &errors.lights {
        append(&mut plain, LIGHT_ERRORS, &encode_record(errors));
    }
    if let Some(errors) = &errors.denoising {
        append(&mut plain, DENOISING_ERRORS, &encode_record(errors));
    }
    if !errors.denoised_lights.is_empty() {
        append(&mut plain, DENOISED_LIGHTS, &encode_record(&errors.denoised_lights));
    }
    if let Some(error) = &errors.exposed {
        append(&mut plain, EXPOSED_ERROR, &encode_record(error));
    }
    let packed = zstd::bulk::compress(&plain, if plain.len() < LARGE_BYTES { 19 } else { 9 })
        .expect("compressing into memory cannot fail");
    let compressed = packed.len() < plain.len() && plain.len() <= allowed(packed.len());
    let mut bytes = Vec::new();
    bytes.extend((plain.len() as u32).to_le_bytes());
    bytes.extend(u32::from(compressed).to_le_bytes());
    bytes.extend(if compressed { packed } else { plain });
    bytes
}

/// Decodes the metadata of a file of a known version, refusing lengths that the bytes have not earned.
pub(super) fn decode(version: u32, bytes: &[u8]) -> Result<Metadata, String> {
    let metadata = match version {
        VERSION_WITHOUT_SECTIONS => decode_positional(bytes)?,
        _ => decode_sections(bytes)?,
    };
    let (job, _, StatedErrors { lights, denoised_lights, .. }) = &metadata;
    let (told, known) = (denoised_lights.len(), job.basis.lights().len());
    if told != 0 && told != known {
        return Err(format!("the errors of denoising are of {told} lights, there are {known}"));
    }
    if let Some(worst) = lights.map(|lights| lights.worst_column).filter(|&c| c as usize >= job.shape.columns()) {
        return Err(format!("the errors of lights name column {worst}, beyond the last"));
    }
    Ok(metadata)
}

fn decode_sections(bytes: &[u8]) -> Result<Metadata, String> {
    let Some((head, body)) = bytes.split_first_chunk::<8>() else {
        return Err("the metadata is cut short".into());
    };
    let plain = unpacked(body, u32_at(head, 4), u32_at(head, 0) as usize)?;
    let known = [&JOB_SECTIONS[..], &[REPORT, LIGHT_ERRORS, DENOISING_ERRORS, DENOISED_LIGHTS, EXPOSED_ERROR]].concat();
    let sections = Sections::split(&plain, &known)?;
    let errors = StatedErrors {
        lights: section(&sections, LIGHT_ERRORS, "errors of lights")?,
        denoising: section(&sections, DENOISING_ERRORS, "errors of denoising")?,
        denoised_lights: section::<Vec<DenoisedLight>>(&sections, DENOISED_LIGHTS, "errors of denoised lights")?
            .unwrap_or_default(),
        exposed: section(&sections, EXPOSED_ERROR, "error of exposed images")?,
    };
    Ok((job_of(&sections)?, section(&sections, REPORT, "report")?.unwrap_or_default(), errors))
}

/// The record of a section, which fills it; none where there is no such section.
fn section<T: Decode<()>>(sections: &Sections<'_>, tag: Tag, name: &str) -> Result<Option<T>, String> {
    let Some(body) = sections.body(tag) else { return Ok(None) };
    match decode_record(body) {
        Ok((record, used)) if used == body.len() => Ok(Some(record)),
        Ok((_, used)) => Err(format!("the section of the {name} has {} trailing bytes", body.len() - used)),
        Err(e) => Err(format!("the section of the {name} does not decode ({e})")),
    }
}

/// Decodes the metadata of version 1: job and report one after the other, then the errors as far as they are known.
fn decode_positional(bytes: &[u8]) -> Result<Metadata, String> {
    let Some((head, body)) = bytes.split_first_chunk::<12>() else {
        return Err("the metadata is cut short".into());
    };
    let (job_bytes, report_bytes) = (u32_at(head, 0) as usize, u32_at(head, 4) as usize);
    let plain = unpacked(body, u32_at(head, 8), job_bytes + report_bytes)?;
    let job = decode_positional_job(&plain[..job_bytes])?;
    let mut rest = &plain[job_bytes..];
    let report = next(&mut rest, "report")?.ok_or("the report is missing")?;
    let errors = StatedErrors {
        lights: next(&mut rest, "errors of lights")?,
        denoising: next(&mut rest, "errors of denoising")?.filter(|errors: &DenoiseErrors| !errors.is_none()),
        denoised_lights: Vec::new(),
        exposed: next(&mut rest, "error of exposed images")?,
    };
    match rest.len() {
        0 => Ok((job, report, errors)),
        bytes => Err(format!("the report has {bytes} trailing bytes")),
    }
}

/// The record at the start of `rest`, which is shortened by it; none at the end.
fn next<T: Decode<()>>(rest: &mut &[u8], name: &str) -> Result<Option<T>, String> {
    if rest.is_empty() {
        return Ok(None);
    }
    let (record, used) = decode_record(rest).map_err(|e| format!("the {name} does not decode ({e})"))?;
    *rest = &rest[used..];
    Ok(Some(record))
}

/// The body of metadata, which are `plain_bytes` long and compressed as `flag` says.
fn unpacked(body: &[u8], flag: u32, plain_bytes: usize) -> Result<Cow<'_, [u8]>, String> {
    let plain: Cow<'_, [u8]> = match flag {
        0 => body.into(),
        1 if plain_bytes <= allowed(body.len()) => zstd::bulk::decompress(body, plain_bytes)
            .map_err(|e| format!("the metadata does not decompress ({e})"))?
            .into(),
        1 => return Err("the metadata claims more than its bytes can hold".into()),
        flag => return Err(format!("the metadata is compressed in an unknown way ({flag})")),
    };
    match plain.len() == plain_bytes {
        true => Ok(plain),
        false => Err("the metadata's lengths do not fit each other".into()),
    }
}

fn allowed(packed_bytes: usize) -> usize {
    FREE_BYTES + EARNED_PER_BYTE * packed_bytes
}
