//! The fixed bytes of a container: header, index records, trailer. All little-endian.

use crate::matrix::BlockReport;

/// Version of the format that this program writes; it reads this one and all earlier ones.
pub const FORMAT_VERSION: u32 = 2;
/// The version whose metadata stand one after the other, before they became tagged sections.
pub(super) const VERSION_WITHOUT_SECTIONS: u32 = 1;

/// First bytes of a container. The high bit, the line ends and the control-Z show transfers that were not binary.
pub(super) const HEADER_MAGIC: [u8; 8] = *b"\x89LTC\r\n\x1a\n";
/// First bytes of the trailer.
pub(super) const TRAILER_MAGIC: [u8; 8] = *b"LTCindex";
/// Bytes of the header.
pub(super) const HEADER_BYTES: usize = 64;
/// Bytes of the trailer, the last of the file.
pub(super) const TRAILER_BYTES: usize = 64;
/// Bytes of a block's record in the index.
pub(super) const BLOCK_RECORD_BYTES: usize = 32;
/// Bytes of a layer's record in the index.
pub(super) const LAYER_RECORD_BYTES: usize = 16;
/// Most layers of a block.
pub(crate) const MAX_LAYERS: usize = 16;

fn check_version(version: u32) -> Result<(), String> {
    match version {
        VERSION_WITHOUT_SECTIONS..=FORMAT_VERSION => Ok(()),
        _ => Err(format!("it is of format version {version}; this program reads up to {FORMAT_VERSION}")),
    }
}

/// The header: says what the file is before anything else is read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ContainerHeader {
    pub(super) version: u32,
    pub(super) block_count: u32,
    pub(super) job_hash: [u8; 32],
}

impl ContainerHeader {
    /// Encodes the header.
    pub(super) fn encode(&self) -> [u8; HEADER_BYTES] {
        let mut bytes = [0; HEADER_BYTES];
        bytes[0..8].copy_from_slice(&HEADER_MAGIC);
        bytes[8..12].copy_from_slice(&self.version.to_le_bytes());
        bytes[12..16].copy_from_slice(&self.block_count.to_le_bytes());
        bytes[16..48].copy_from_slice(&self.job_hash);
        let crc = crc32fast::hash(&bytes[..60]);
        bytes[60..64].copy_from_slice(&crc.to_le_bytes());
        bytes
    }

    /// Reads and checks a header.
    pub(super) fn decode(bytes: &[u8]) -> Result<Self, String> {
        if bytes.len() < HEADER_BYTES || bytes[0..8] != HEADER_MAGIC {
            return Err("it does not begin as a container".into());
        }
        let version = u32_at(bytes, 8);
        check_version(version)?;
        if u32_at(bytes, 60) != crc32fast::hash(&bytes[..60]) {
            return Err("the header's checksum does not fit".into());
        }
        if bytes[48..60] != [0; 12] {
            return Err("the header's reserved bytes are not zero".into());
        }
        let job_hash = bytes[16..48].try_into().expect("32 bytes");
        Ok(Self { version, block_count: u32_at(bytes, 12), job_hash })
    }
}

/// The trailer: where the metadata and the index stand.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Trailer {
    pub(super) version: u32,
    /// Offset of the metadata, where the chunks end.
    pub(super) metadata_offset: u64,
    /// Bytes of the metadata.
    pub(super) metadata_bytes: u32,
    pub(super) block_count: u32,
    pub(super) layer_count: u32,
    /// CRC-32 of metadata and index together.
    pub(super) tail_crc: u32,
    /// CRC-32 that stands in the header.
    pub(super) header_crc: u32,
    pub(super) file_bytes: u64,
}

impl Trailer {
    /// Encodes the trailer.
    pub(super) fn encode(&self) -> [u8; TRAILER_BYTES] {
        let mut bytes = [0; TRAILER_BYTES];
        bytes[0..8].copy_from_slice(&TRAILER_MAGIC);
        bytes[8..12].copy_from_slice(&self.version.to_le_bytes());
        bytes[12..16].copy_from_slice(&self.block_count.to_le_bytes());
        bytes[16..20].copy_from_slice(&self.layer_count.to_le_bytes());
        bytes[20..24].copy_from_slice(&self.metadata_bytes.to_le_bytes());
        bytes[24..32].copy_from_slice(&self.metadata_offset.to_le_bytes());
        bytes[32..40].copy_from_slice(&self.file_bytes.to_le_bytes());
        bytes[40..44].copy_from_slice(&self.tail_crc.to_le_bytes());
        bytes[44..48].copy_from_slice(&self.header_crc.to_le_bytes());
        let crc = crc32fast::hash(&bytes[..60]);
        bytes[60..64].copy_from_slice(&crc.to_le_bytes());
        bytes
    }

    /// Reads and checks a trailer against the real size of its file.
    pub(super) fn decode(bytes: &[u8], file_bytes: u64) -> Result<Self, String> {
        if bytes.len() != TRAILER_BYTES || bytes[0..8] != TRAILER_MAGIC {
            return Err("it does not end as a container".into());
        }
        let version = u32_at(bytes, 8);
        check_version(version)?;
        if u32_at(bytes, 60) != crc32fast::hash(&bytes[..60]) {
            return Err("the trailer's checksum does not fit".into());
        }
        if bytes[48..60] != [0; 12] {
            return Err("the trailer's reserved bytes are not zero".into());
        }
        let trailer = Self {
            version,
            block_count: u32_at(bytes, 12),
            layer_count: u32_at(bytes, 16),
            metadata_bytes: u32_at(bytes, 20),
            metadata_offset: u64_at(bytes, 24),
            tail_crc: u32_at(bytes, 40),
            header_crc: u32_at(bytes, 44),
            file_bytes: u64_at(bytes, 32),
        };
        if trailer.file_bytes != file_bytes {
            return Err(format!("it has {file_bytes} bytes but was written with {}", trailer.file_bytes));
        }
        if trailer.metadata_offset < HEADER_BYTES as u64
            || trailer.metadata_offset.checked_add(trailer.tail_bytes()) != Some(file_bytes)
        {
            return Err("metadata, index and trailer do not fill the end of the file".into());
        }
        Ok(trailer)
    }

    /// Bytes of metadata, index and trailer. Cannot overflow: the counts are 32-bit.
    pub(super) fn tail_bytes(&self) -> u64 {
        u64::from(self.metadata_bytes)
            + u64::from(self.block_count) * BLOCK_RECORD_BYTES as u64
            + u64::from(self.layer_count) * LAYER_RECORD_BYTES as u64
            + TRAILER_BYTES as u64
    }
}

/// A block in the index.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct BlockRecord {
    /// First of its layers in the table of layers.
    pub(super) first_layer: u32,
    /// Number of its layers; 0 for a black block.
    pub(super) layers: u8,
    /// Whether the file holds the block; a container of a block range does not hold the others.
    pub(super) present: bool,
    /// Components of all layers.
    pub(super) rank: u16,
    /// Sparse entries of all layers.
    pub(super) sparse_entries: u32,
    pub(super) report: BlockReport,
}

impl BlockRecord {
    /// Encodes the record.
    pub(super) fn encode(&self) -> [u8; BLOCK_RECORD_BYTES] {
        let mut bytes = [0; BLOCK_RECORD_BYTES];
        bytes[0..4].copy_from_slice(&self.first_layer.to_le_bytes());
        bytes[4] = self.layers;
        bytes[5] = u8::from(self.present);
        bytes[6..8].copy_from_slice(&self.rank.to_le_bytes());
        bytes[8..12].copy_from_slice(&self.sparse_entries.to_le_bytes());
        let report = &self.report;
        let figures = [report.squared_error, report.squared_norm, report.noise_variance, report.uniform_error];
        for (place, figure) in bytes[12..28].chunks_exact_mut(4).zip(figures) {
            place.copy_from_slice(&(figure as f32).to_le_bytes());
        }
        bytes
    }

    /// Reads a record; `None` where a flag or reserved byte has no meaning, or components are claimed without a layer.
    pub(super) fn decode(bytes: &[u8]) -> Option<Self> {
        let figure = |at| f64::from(f32::from_bits(u32_at(bytes, at)));
        let holds_something = bytes[4] > 0;
        let claims_something = bytes[6..12] != [0; 6];
        let known = bytes[5] <= 1 && bytes[28..32] == [0; 4] && usize::from(bytes[4]) <= MAX_LAYERS;
        // Without layers there are no components, and without the block no layers.
        let fits = (holds_something || !claims_something) && (bytes[5] == 1 || !holds_something);
        (known && fits).then(|| Self {
            first_layer: u32_at(bytes, 0),
            layers: bytes[4],
            present: bytes[5] == 1,
            rank: u16::from_le_bytes([bytes[6], bytes[7]]),
            sparse_entries: u32_at(bytes, 8),
            report: BlockReport {
                squared_error: figure(12),
                squared_norm: figure(16),
                noise_variance: figure(20),
                uniform_error: figure(24),
            },
        })
    }
}

/// A layer of a block in the index: where its chunk stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct LayerRecord {
    pub(super) offset: u64,
    pub(super) bytes: u32,
    pub(super) crc: u32,
}

impl LayerRecord {
    /// Encodes the record.
    pub(super) fn encode(&self) -> [u8; LAYER_RECORD_BYTES] {
        let mut bytes = [0; LAYER_RECORD_BYTES];
        bytes[0..8].copy_from_slice(&self.offset.to_le_bytes());
        bytes[8..12].copy_from_slice(&self.bytes.to_le_bytes());
        bytes[12..16].copy_from_slice(&self.crc.to_le_bytes());
        bytes
    }

    /// Reads a record.
    pub(super) fn decode(bytes: &[u8]) -> Self {
        Self { offset: u64_at(bytes, 0), bytes: u32_at(bytes, 8), crc: u32_at(bytes, 12) }
    }
}

/// The 32-bit number at `at`. Panics beyond the end: callers have checked the length.
pub(super) fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().expect("4 bytes"))
}

/// The 64-bit number at `at`. Panics beyond the end: callers have checked the length.
pub(super) fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().expect("8 bytes"))
}

#[cfg(test)]
mod tests {
    use super::super::{ContainerReport, metadata};
    use super::*;
    use crate::light::{Job, Light, LightBasis, LightKind, Provenance, StatedErrors, encode_job};
    use crate::matrix::MatrixShape;

    /// The rows `(offset, size, field)` of the table under a heading of `formats/ltc.md`.
    fn table(heading: &str) -> Vec<(usize, usize, String)> {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/formats/ltc.md");
        let text = std::fs::read_to_string(path).unwrap();
        let section = text.split(&format!("\n## {heading}\n")).nth(1).unwrap().split("\n## ").next().unwrap();
        let cells = |line: &str| line.split('|').map(|cell| cell.trim().to_owned()).collect::<Vec<_>>();
        let rows = section.lines().map(cells).filter(|cells| cells.len() > 4 && cells[1].parse::<usize>().is_ok());
        rows.map(|cells| (cells[1].parse().unwrap(), cells[2].parse().unwrap(), cells[3].clone())).collect()
    }

    /// Holds a table to encoded bytes: the fields follow each other to the end, and each holds what it is said to.
    fn check(heading: &str, bytes: &[u8], fields: &[(&str, Vec<u8>)]) {
        let rows = table(heading);
        let mut end = 0;
        for ((offset, size, name), (field, value)) in rows.iter().zip(fields) {
            assert_eq!((*offset, name.as_str()), (end, *field), "{heading}");
            assert_eq!(&bytes[*offset..offset + size], value, "{heading}: {name}");
            end += size;
        }
        assert_eq!((end, rows.len()), (bytes.len(), fields.len()), "{heading}");
    }

    fn le(value: u32) -> Vec<u8> {
        value.to_le_bytes().to_vec()
    }

    #[test]
    fn the_tables_of_the_format_document_are_what_is_written() {
        let header = ContainerHeader { version: FORMAT_VERSION, block_count: 0x0102_0304, job_hash: [7; 32] }.encode();
        let crc = header[60..].to_vec();
        check(
            "Header",
            &header,
            &[
                ("magic", HEADER_MAGIC.to_vec()),
                ("version", le(2)),
                ("block count", le(0x0102_0304)),
                ("job hash", vec![7; 32]),
                ("reserved", vec![0; 12]),
                ("checksum", crc),
            ],
        );
        let trailer = Trailer {
            version: FORMAT_VERSION,
            metadata_offset: 0x1122_3344_5566,
            metadata_bytes: 11,
            block_count: 12,
            layer_count: 13,
            tail_crc: 14,
            header_crc: 15,
            file_bytes: 16,
        }
        .encode();
        let crc = trailer[60..].to_vec();
        check(
            "Trailer",
            &trailer,
            &[
                ("magic", TRAILER_MAGIC.to_vec()),
                ("version", le(2)),
                ("block count", le(12)),
                ("layer count", le(13)),
                ("metadata bytes", le(11)),
                ("metadata offset", 0x1122_3344_5566u64.to_le_bytes().to_vec()),
                ("file bytes", 16u64.to_le_bytes().to_vec()),
                ("tail checksum", le(14)),
                ("header checksum", le(15)),
                ("reserved", vec![0; 12]),
                ("checksum", crc),
            ],
        );
        let report = BlockReport { squared_error: 1.0, squared_norm: 2.0, noise_variance: 3.0, uniform_error: 4.0 };
        let block = BlockRecord { first_layer: 9, layers: 2, present: true, rank: 515, sparse_entries: 77, report };
        assert_eq!(BlockRecord::decode(&block.encode()), Some(block));
        let float = |value: f32| value.to_le_bytes().to_vec();
        check(
            "Block record",
            &block.encode(),
            &[
                ("first layer", le(9)),
                ("layers", vec![2]),
                ("present", vec![1]),
                ("rank", vec![3, 2]),
                ("sparse entries", le(77)),
                ("squared error", float(1.0)),
                ("squared norm", float(2.0)),
                ("noise variance", float(3.0)),
                ("uniform error", float(4.0)),
                ("reserved", le(0)),
            ],
        );
        let layer = LayerRecord { offset: 5, bytes: 6, crc: 7 };
        assert_eq!(LayerRecord::decode(&layer.encode()), layer);
        let offset = 5u64.to_le_bytes().to_vec();
        check("Layer record", &layer.encode(), &[("offset", offset), ("bytes", le(6)), ("checksum", le(7))]);
    }

    #[test]
    fn metadata_begin_as_the_format_document_says() {
        let mut basis = LightBasis::new();
        basis.push(Light::unplaced("lamp", LightKind::Lamp)).unwrap();
        let shape = MatrixShape::new(8, 8, 1, 8).unwrap();
        let job = Job { shape, basis, provenance: Provenance::default() };
        let (report, errors) = (ContainerReport::default(), StatedErrors::default());
        let metadata = metadata::encode(&job, &report, &errors);
        // The job's sections, and that of a report of six empty texts and lists.
        let sections = encode_job(&job).len() as u32 + 8 + 6;
        let head = [("sections bytes", le(sections)), ("compressed", le(1))];
        check("Metadata", &metadata[..8], &head);
        assert!(metadata::decode(FORMAT_VERSION, &metadata).unwrap() == (job, report, errors));
    }

    #[test]
    fn the_document_knows_this_version() {
        let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/formats/ltc.md")).unwrap();
        let mut rows = text.lines().skip_while(|line| !line.starts_with("| version |")).skip(2);
        let last = rows.by_ref().take_while(|line| line.starts_with('|')).last().unwrap();
        assert!(last.starts_with(&format!("| {FORMAT_VERSION} |")), "{last}");
    }
}
