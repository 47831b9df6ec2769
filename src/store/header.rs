//! The header page and the job description behind it.

use crate::error::{Error, Result};
use crate::light::{Clusters, Job, decode_job, decode_positional_job, encode_job};
use crate::matrix::{FEATURE_PLANES, MatrixShape};
use std::path::Path;

use super::storage::{Storage, read_exact};
use super::{PAGE_BYTES, Precision, StoreLayout, StoreOptions, disk_structure};

/// First bytes of every `.ltm` file: a byte above 127, the name, and line ends that a text transfer would change.
pub const MAGIC: [u8; 8] = *b"\x89LTM\r\n\x1a\n";
/// Version of the format that this program writes; it reads this one and all earlier ones, and goes on with their files.
pub const VERSION: u32 = 5;
/// The version of files without planes: the first.
const VERSION_WITHOUT_PLANES: u32 = 1;
/// The version whose planes do not know materials.
const VERSION_WITHOUT_MATERIAL: u32 = 2;
/// The last version whose job description stands in fixed order, before it became tagged sections.
const VERSION_WITHOUT_SECTIONS: u32 = 3;
/// The last version whose planes do not know the albedo of pixels by further rays.
const VERSION_WITHOUT_PIXEL_ALBEDO: u32 = 4;
/// Planes of features without materials, and without the albedo of pixels.
const FEATURES_WITHOUT_MATERIAL: u32 = 10;
pub(super) const FEATURES_WITHOUT_PIXEL_ALBEDO: u32 = 11;

disk_structure! {
    /// The header as it lies at the start of the header page; the rest of the page is zero.
    HeaderBytes,
    /// Fields of the header.
    HEADER_FIELDS {
        magic: [u8; 8],
        checksum: u32,
        version: u32,
        precision: u32,
        max_probes: u32,
        width: u32,
        height: u32,
        columns: u32,
        block_side: u32,
        job_checksum: u32,
        clusters: u32,
        job_bytes: u64,
        table_offset: u64,
        slots_offset: u64,
        file_bytes: u64,
    }
}

/// First byte of the header page that its checksum covers: the one after the checksum.
const CHECKED_FROM: usize = 12;
/// Longest job description: of the scene and settings, and of each column with its light's name.
const JOB_BYTES: u64 = 1 << 20;
const JOB_BYTES_PER_COLUMN: u64 = 512;
const PAGE: usize = PAGE_BYTES as usize;

/// A header page as read: not to be believed.
pub(super) struct UnverifiedHeader(Box<[u8; PAGE]>);

/// A header whose checksum held and whose fields fit each other, with the job description that it vouches for.
#[derive(Clone, Debug)]
pub(super) struct StoreHeader {
    pub(super) layout: StoreLayout,
    pub(super) job: Job,
    /// Whether there are planes, of the clusters that [`Clusters`] makes today.
    pub(super) planes_known: bool,
}

/// The beginning of a new file.
pub(super) struct EncodedHeader {
    pub(super) layout: StoreLayout,
    /// The header page.
    pub(super) page: [u8; PAGE],
    /// The job description, padded to whole pages.
    pub(super) description: Vec<u8>,
}

impl StoreHeader {
    /// What a new file begins with.
    pub(super) fn encode(job: &Job, options: &StoreOptions) -> EncodedHeader {
        let mut description = encode_job(job);
        let layout = StoreLayout::new(job, options, description.len() as u64);
        description.resize(description.len().next_multiple_of(PAGE), 0);
        let fields = HeaderBytes {
            magic: MAGIC,
            checksum: 0,
            version: VERSION,
            precision: layout.precision.code(),
            max_probes: layout.max_probes,
            width: job.shape.width(),
            height: job.shape.height(),
            columns: job.shape.columns() as u32,
            block_side: job.shape.block_side(),
            job_checksum: crc32fast::hash(&description),
            clusters: layout.clusters,
            job_bytes: layout.job_bytes,
            table_offset: layout.table_offset(),
            slots_offset: layout.slots_offset(),
            file_bytes: layout.file_bytes(),
        };
        let mut page = [0; PAGE];
        page[..size_of::<HeaderBytes>()].copy_from_slice(bytemuck::bytes_of(&fields));
        let checksum = crc32fast::hash(&page[CHECKED_FROM..]);
        page[8..CHECKED_FROM].copy_from_slice(&checksum.to_le_bytes());
        EncodedHeader { layout, page, description }
    }

    /// Reads and verifies the header and the job description.
    pub(super) fn read(storage: &impl Storage, path: &Path) -> Result<Self> {
        UnverifiedHeader::read(storage, path)?.verify(storage, path)
    }
}

impl UnverifiedHeader {
    /// Reads the header page. Errors: not there, not ours, or shorter than a header page.
    pub(super) fn read(storage: &impl Storage, path: &Path) -> Result<Self> {
        let length = storage.length().map_err(Error::io(path, "ask for the length"))?;
        let start = length.min(PAGE_BYTES) as usize;
        let mut page = Box::new([0; PAGE]);
        read_exact(storage, 0, &mut page[..start]).map_err(Error::io(path, "read the header"))?;
        if !page.starts_with(&MAGIC[..start.min(MAGIC.len())]) || start == 0 {
            return Err(Error::input(
                path.display().to_string(),
                "is not an .ltm file",
                "give a file that `ltm` wrote",
            ));
        }
        if start < PAGE {
            let problem = format!("the file is cut short inside the header: {length} bytes of at least {PAGE}");
            return Err(Error::damaged(path, problem, "render it again"));
        }
        Ok(Self(page))
    }

    /// Whether nothing was written yet: a writer stopped before it had begun.
    pub(super) fn is_blank(storage: &impl Storage) -> std::io::Result<bool> {
        let mut page = [0; PAGE];
        let start = storage.length()?.min(PAGE_BYTES) as usize;
        read_exact(storage, 0, &mut page[..start])?;
        Ok(page.iter().all(|&byte| byte == 0))
    }

    /// Whether the file begins with our magic bytes.
    pub(super) fn is_ours(storage: &impl Storage) -> std::io::Result<bool> {
        let mut start = [0; MAGIC.len()];
        if storage.length()? < start.len() as u64 {
            return Ok(false);
        }
        read_exact(storage, 0, &mut start)?;
        Ok(start == MAGIC)
    }

    /// Verifies the header: its checksum, a known version, every field in range and consistent with the layout, and the
    /// job description's checksum and shape.
    pub(super) fn verify(self, storage: &impl Storage, path: &Path) -> Result<StoreHeader> {
        let damaged = |problem: String| Error::damaged(path, problem, "render it again, or take it from a copy");
        let fields: HeaderBytes = bytemuck::pod_read_unaligned(&self.0[..size_of::<HeaderBytes>()]);
        if crc32fast::hash(&self.0[CHECKED_FROM..]) != fields.checksum {
            return Err(damaged("the header's checksum does not hold".into()));
        }
        if !(VERSION_WITHOUT_PLANES..=VERSION).contains(&fields.version) {
            let problem = format!("has format version {}, this program reads up to {VERSION}", fields.version);
            return Err(Error::input(path.display().to_string(), problem, "use a program of that version"));
        }
        let precision = Precision::from_code(fields.precision)
            .ok_or_else(|| damaged(format!("the header names an unknown precision, {}", fields.precision)))?;
        let shape = MatrixShape::new(fields.width, fields.height, fields.columns, fields.block_side)
            .map_err(|e| damaged(format!("the header's shape is impossible: {e}")))?;
        let length = storage.length().map_err(Error::io(path, "ask for the length"))?;
        // A sparse file may have any length: memory for the description is earned by the columns that it describes.
        let most = JOB_BYTES + JOB_BYTES_PER_COLUMN * u64::from(fields.columns);
        if fields.job_bytes > most {
            let problem =
                format!("the job description claims {} bytes, its columns take {most} at most", fields.job_bytes);
            return Err(damaged(problem));
        }
        let HeaderBytes { max_probes, clusters, job_bytes, .. } = fields;
        let has_planes = clusters > 0;
        let planes_fit = match fields.version {
            VERSION_WITHOUT_PLANES => !has_planes,
            ..=VERSION_WITHOUT_SECTIONS => has_planes,
            _ => true,
        };
        if max_probes > Self::MAX_PROBES || !planes_fit || clusters as usize > Clusters::MAX {
            return Err(damaged("the header's fields are out of range".into()));
        }
        let features = match fields.version {
            _ if !has_planes => 0,
            VERSION_WITHOUT_MATERIAL => FEATURES_WITHOUT_MATERIAL,
            ..=VERSION_WITHOUT_PIXEL_ALBEDO => FEATURES_WITHOUT_PIXEL_ALBEDO,
            _ => FEATURE_PLANES as u32,
        };
        let layout = StoreLayout { shape, precision, max_probes, clusters, features, job_bytes };
        let said = (fields.table_offset, fields.slots_offset, fields.file_bytes);
        if said != (layout.table_offset(), layout.slots_offset(), layout.file_bytes()) {
            return Err(damaged("the header's offsets do not fit its shape".into()));
        }
        if length < layout.table_offset() {
            let needed = layout.table_offset();
            return Err(damaged(format!(
                "the file is cut short inside the job description: {length} bytes of at least {needed}"
            )));
        }
        let mut description = vec![0; (layout.table_offset() - layout.job_offset()) as usize];
        read_exact(storage, layout.job_offset(), &mut description).map_err(Error::io(path, "read the description"))?;
        if crc32fast::hash(&description) != fields.job_checksum {
            return Err(damaged("the job description's checksum does not hold".into()));
        }
        let description = &description[..fields.job_bytes as usize];
        let job = match fields.version {
            ..=VERSION_WITHOUT_SECTIONS => decode_positional_job(description),
            _ => decode_job(description),
        };
        let job = job.map_err(damaged)?;
        if job.shape != shape {
            return Err(damaged("the header and the job description differ in shape".into()));
        }
        let planes_known = has_planes && clusters as usize == Clusters::of_basis(&job.basis).count();
        if has_planes && !planes_known && !Clusters::were(&job.basis, clusters as usize) {
            return Err(damaged("the header and the job description differ in clusters of columns".into()));
        }
        Ok(StoreHeader { layout, job, planes_known })
    }

    /// Bound on the probes of a block.
    const MAX_PROBES: u32 = 4096;
}
