//! Blocks packed into the arrays that the kernels read. Knows the layout of `shaders/`, not the GPU.

use std::ops::Range;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};

use crate::matrix::{BlockId, CHANNELS};
use crate::relight::compact::{CompactBlock, FactorPart};
use crate::relight::right::Cell;

/// One component of a block, as in `shaders/layout.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct GpuComponent {
    first_cell: u32,
    cells: u32,
    left_word: u32,
    is_narrow: u32,
}

/// What a row of a right factor has in one tile, as in `shaders/layout.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct GpuCell {
    word: u32,
    /// Groups of dense numbers, and above 16 bits entries.
    lengths: u32,
    first: u32,
    scale: f32,
}

/// One block, as in `shaders/layout.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct GpuBlock {
    first_component: u32,
    component_count: u32,
    pixels: u32,
    first_pixel: u32,
    id: u32,
}

/// One row with sparse entries, as in `shaders/layout.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct SparseRow {
    target_index: u32,
    first: u32,
    end: u32,
}

/// One sparse entry, as in `shaders/layout.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct GpuSparseEntry {
    column: u32,
    value: f32,
}

/// Numbers of things in a bank, as in `shaders/layout.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Sizes {
    pub columns: u32,
    pub coefficients: u32,
    pub components: u32,
    pub blocks: u32,
    pub sparse_rows: u32,
}

/// A block packed into the arrays of a bank in which it would stand alone.
#[derive(Debug)]
pub(super) struct Packed {
    pub id: BlockId,
    pixels: u32,
    components: Vec<GpuComponent>,
    cells: Vec<GpuCell>,
    factors: Factors,
    rows: Vec<SparseRow>,
    entries: Vec<GpuSparseEntry>,
}

/// Blocks whose arrays each fit one binding, one behind the other.
#[derive(Debug, Default)]
pub(super) struct Bank {
    packed: Vec<Packed>,
    pub blocks: Vec<GpuBlock>,
    lengths: Lengths,
    pub max_pixels: u32,
}

/// The array of factors of a block, most of which stays where the block holds it.
#[derive(Debug, Default)]
pub(super) struct Factors {
    /// Words of the array.
    words: usize,
    spans: Vec<Span>,
    /// Bytes of the spans that had to be padded.
    padded: Vec<u8>,
}

/// A part of the array of factors.
#[derive(Debug)]
enum Span {
    /// The right factor, as the block holds it.
    Right(Arc<CompactBlock>),
    /// Left sides in 8 bits, as the block holds them.
    Narrow(Arc<CompactBlock>),
    /// Left sides in 16 bits.
    Wide(Arc<CompactBlock>),
    /// Planes that would end in the midst of a word, as bytes of their own.
    Padded(Range<usize>),
}

impl Factors {
    /// The bytes of the array, span by span.
    pub(super) fn bytes(&self) -> impl Iterator<Item = &[u8]> {
        self.spans.iter().map(|span| match span {
            Span::Right(block) => bytemuck::cast_slice(&block.right.words),
            Span::Narrow(block) => bytemuck::cast_slice(&block.left.narrow.values),
            Span::Wide(block) => bytemuck::cast_slice(&block.left.wide.values),
            Span::Padded(range) => &self.padded[range.clone()],
        })
    }

    /// Appends the right factor; returns its first word.
    fn push_right(&mut self, block: &Arc<CompactBlock>) -> u32 {
        let first = self.words;
        self.words += block.right.words.len();
        self.spans.push(Span::Right(Arc::clone(block)));
        first as u32
    }

    /// Appends the planes of the left factor, each padded to four values; returns (component, first word, whether in 8 bits).
    fn push_left(&mut self, block: &Arc<CompactBlock>) -> Vec<(u32, u32, bool)> {
        let (factor, plane) = (&block.left, block.pixels());
        let narrow = self.push_part(&factor.narrow, CHANNELS, plane, Span::Narrow(Arc::clone(block)));
        let wide = self.push_part(&factor.wide, CHANNELS, plane, Span::Wide(Arc::clone(block)));
        let narrow = narrow.into_iter().map(|(k, word)| (k, word, true));
        narrow.chain(wide.into_iter().map(|(k, word)| (k, word, false))).collect()
    }

    /// Appends the components of one precision, which `held` holds without padding; returns (component, first word).
    fn push_part<Q: Pod>(&mut self, part: &FactorPart<Q>, planes: usize, plane: usize, held: Span) -> Vec<(u32, u32)> {
        let span = if plane.is_multiple_of(4) { held } else { self.pad(&part.values, plane) };
        self.spans.push(span);
        // Four bytes take a word, four values as many words as a value has bytes.
        let (first, words) = (self.words, planes * plane.div_ceil(4) * size_of::<Q>());
        self.words += words * part.components.len();
        part.components.iter().enumerate().map(|(i, &k)| (k, (first + i * words) as u32)).collect()
    }

    /// Copies planes, each with zeros up to a multiple of four values.
    fn pad<Q: Pod>(&mut self, values: &[Q], plane: usize) -> Span {
        let start = self.padded.len();
        for plane in values.chunks_exact(plane) {
            self.padded.extend_from_slice(bytemuck::cast_slice(plane));
            let missing = plane.len().next_multiple_of(4) - plane.len();
            self.padded.resize(self.padded.len() + missing * size_of::<Q>(), 0);
        }
        Span::Padded(start..self.padded.len())
    }
}

/// Lengths of the arrays of a bank, or what a block adds to them.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Lengths {
    factor_words: usize,
    pub components: usize,
    cells: usize,
    pub blocks: usize,
    pub sparse_rows: usize,
    sparse_entries: usize,
    pub pixels: usize,
}

impl Lengths {
    /// At most those of [`CompactBlock::piece`], once that is packed: rows may have several entries.
    pub(super) fn of_piece(block: &CompactBlock, components: &Range<u32>) -> Self {
        let rank = components.len();
        let (narrow, wide) = block.left.count(components);
        let (right_words, cells) = block.right.count(components);
        let factor_words = right_words + CHANNELS * block.pixels().div_ceil(4) * (narrow + 2 * wide);
        let entries = if components.start == 0 { block.sparse.rows.len() } else { 0 };
        Self {
            factor_words,
            components: rank,
            cells,
            blocks: 1,
            sparse_rows: entries,
            sparse_entries: entries,
            pixels: block.pixels(),
        }
    }

    pub(super) fn plus(self, other: Self) -> Self {
        Self {
            factor_words: self.factor_words + other.factor_words,
            components: self.components + other.components,
            cells: self.cells + other.cells,
            blocks: self.blocks + other.blocks,
            sparse_rows: self.sparse_rows + other.sparse_rows,
            sparse_entries: self.sparse_entries + other.sparse_entries,
            pixels: self.pixels + other.pixels,
        }
    }

    /// Bytes of the largest array.
    pub(super) fn largest_bytes(self) -> u64 {
        let sizes = [
            size_of::<u32>() * self.factor_words,
            size_of::<GpuComponent>() * self.components,
            size_of::<GpuCell>() * self.cells,
            size_of::<GpuBlock>() * self.blocks,
            size_of::<SparseRow>() * self.sparse_rows,
            size_of::<GpuSparseEntry>() * self.sparse_entries,
            size_of::<[f32; CHANNELS]>() * self.pixels,
        ];
        sizes.into_iter().max().unwrap_or(0) as u64
    }

    /// Bytes of GPU memory at most, what the kernels make included.
    pub(super) fn bytes(self) -> u64 {
        // Each pixel has its radiance and the copy that is read back.
        let pixel_bytes = 2 * size_of::<[f32; CHANNELS]>();
        let bytes = size_of::<u32>() * self.factor_words
            + self.components * (size_of::<GpuComponent>() + size_of::<[f32; CHANNELS]>())
            + size_of::<GpuCell>() * self.cells
            + size_of::<GpuBlock>() * self.blocks
            + size_of::<SparseRow>() * self.sparse_rows
            + size_of::<GpuSparseEntry>() * self.sparse_entries
            + pixel_bytes * self.pixels;
        // Small arrays are made larger than they need.
        bytes as u64 + 16 * 11
    }
}

impl Packed {
    /// `firsts`: where each tile's coefficients begin in a plane of the lighting.
    pub(super) fn new(id: BlockId, block: &Arc<CompactBlock>, firsts: &[u32]) -> Self {
        let mut factors = Factors::default();
        let (mut components, cells) = right_cells(block, factors.push_right(block), firsts);
        for (k, word, is_narrow) in factors.push_left(block) {
            (components[k as usize].left_word, components[k as usize].is_narrow) = (word, u32::from(is_narrow));
        }
        let (rows, entries) = sparse(block);
        Self { id, pixels: block.pixels() as u32, components, cells, factors, rows, entries }
    }

    pub(super) fn lengths(&self) -> Lengths {
        Lengths {
            factor_words: self.factors.words,
            components: self.components.len(),
            cells: self.cells.len(),
            blocks: 1,
            sparse_rows: self.rows.len(),
            sparse_entries: self.entries.len(),
            pixels: self.pixels as usize,
        }
    }

    /// Moves the block behind others in their arrays.
    fn move_behind(&mut self, others: Lengths) {
        for component in &mut self.components {
            component.first_cell += others.cells as u32;
            component.left_word += others.factor_words as u32;
        }
        self.cells.iter_mut().for_each(|cell| cell.word += others.factor_words as u32);
        let (target_index, entries) = ((CHANNELS * others.pixels) as u32, others.sparse_entries as u32);
        for row in &mut self.rows {
            row.target_index += target_index;
            row.first += entries;
            row.end += entries;
        }
    }
}

/// The components of a block, without their left sides, and the cells that are not empty, component by component. The right
/// factor begins at a word.
fn right_cells(block: &CompactBlock, first_word: u32, firsts: &[u32]) -> (Vec<GpuComponent>, Vec<GpuCell>) {
    let right = &block.right;
    let mut cells: Vec<(u32, GpuCell)> = Vec::with_capacity(right.cells.len());
    let mut word = first_word;
    let of_tiles = right.cells.chunks_exact(right.rows.len().max(1));
    for (of_tile, &first) in of_tiles.zip(firsts) {
        for (&Cell { groups, entries }, row) in of_tile.iter().zip(&right.rows) {
            if groups > 0 || entries > 0 {
                let lengths = u32::from(groups) | u32::from(entries) << 16;
                cells.push((row.component, GpuCell { word, lengths, first, scale: row.scale }));
            }
            word += Cell { groups, entries }.words() as u32;
        }
    }
    cells.sort_by_key(|&(component, _)| component);
    // What is read at word 0 of one without a left side is finite, as bytes are.
    let component = GpuComponent { first_cell: 0, cells: 0, left_word: 0, is_narrow: 1 };
    let mut components = vec![component; block.rank()];
    for (at, &(component, _)) in (0..).zip(&cells) {
        let component = &mut components[component as usize];
        if component.cells == 0 {
            component.first_cell = at;
        }
        component.cells += 1;
    }
    (components, cells.into_iter().map(|(_, cell)| cell).collect())
}

/// The sparse entries of a block, row after row; those of a row in the order of their columns, as the twin adds them.
fn sparse(block: &CompactBlock) -> (Vec<SparseRow>, Vec<GpuSparseEntry>) {
    let pixels = block.pixels();
    let mut rows = Vec::new();
    let mut entries = vec![GpuSparseEntry::zeroed(); block.sparse.rows.len()];
    if entries.is_empty() {
        return (rows, entries);
    }
    // By counting: a comparing sort would take longer than all else that is done to send a block.
    let mut places = vec![0u32; CHANNELS * pixels];
    block.sparse.rows.iter().for_each(|&row| places[row as usize] += 1);
    let mut end = 0;
    for (row, place) in places.iter_mut().enumerate() {
        let (first, count) = (end, std::mem::replace(place, end));
        end += count;
        if count > 0 {
            let target_index = (row % pixels * CHANNELS + row / pixels) as u32;
            rows.push(SparseRow { target_index, first, end });
        }
    }
    for (at, &(column, _)) in block.sparse.ends.iter().enumerate() {
        let (in_rows, values) = block.sparse.of(at);
        for (&row, &value) in in_rows.iter().zip(values) {
            let place = &mut places[row as usize];
            entries[*place as usize] = GpuSparseEntry { column, value };
            *place += 1;
        }
    }
    (rows, entries)
}

impl Bank {
    pub(super) fn lengths(&self) -> Lengths {
        self.lengths
    }

    /// Appends a block.
    pub(super) fn push(&mut self, mut packed: Packed) {
        packed.move_behind(self.lengths);
        self.blocks.push(GpuBlock {
            first_component: self.lengths.components as u32,
            component_count: packed.components.len() as u32,
            pixels: packed.pixels,
            first_pixel: self.lengths.pixels as u32,
            id: packed.id.0,
        });
        self.lengths = self.lengths.plus(packed.lengths());
        self.max_pixels = self.max_pixels.max(packed.pixels);
        self.packed.push(packed);
    }

    /// Its blocks, each with its first pixel.
    pub(super) fn places(&self) -> Vec<(BlockId, u32)> {
        self.blocks.iter().map(|block| (BlockId(block.id), block.first_pixel)).collect()
    }

    /// The arrays to upload beside its sizes, by name: components, cells, blocks, factors, sparse rows and sparse entries,
    /// each in consecutive pieces.
    pub(super) fn arrays(&self) -> [(&'static str, Vec<&[u8]>); 6] {
        fn pieces<'a, T: Pod>(bank: &'a Bank, of: impl Fn(&'a Packed) -> &'a [T]) -> Vec<&'a [u8]> {
            bank.packed.iter().map(|packed| bytemuck::cast_slice(of(packed))).collect()
        }
        [
            ("components", pieces(self, |packed| &packed.components)),
            ("cells", pieces(self, |packed| &packed.cells)),
            ("blocks", vec![bytemuck::cast_slice(&self.blocks)]),
            ("factors", self.packed.iter().flat_map(|packed| packed.factors.bytes()).collect()),
            ("rows", pieces(self, |packed| &packed.rows)),
            ("entries", pieces(self, |packed| &packed.entries)),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::super::kernels::{KERNELS, Kernel, PROJECT_SUBGROUPS, THREADS, TONE};
    use super::super::screen::Tone;
    use super::*;
    use crate::relight::right::PLACE_BITS;
    use std::mem::offset_of;
    use wgpu::naga;

    /// A kernel, with what is bound to it by its name in the shader.
    fn by_names<B: std::fmt::Debug>(kernel: Kernel<B>) -> (&'static str, &'static str, Vec<String>) {
        (
            kernel.name,
            kernel.source,
            kernel.bindings.iter().map(|binding| snake_case(&format!("{binding:?}"))).collect(),
        )
    }

    fn snake_case(name: &str) -> String {
        let mut snake = String::new();
        for c in name.chars() {
            if c.is_uppercase() && !snake.is_empty() {
                snake.push('_');
            }
            snake.extend(c.to_lowercase());
        }
        snake
    }

    /// Name, source and bindings.
    fn all_kernels() -> impl Iterator<Item = (&'static str, &'static str, Vec<String>)> {
        let relighting = KERNELS.into_iter().map(|(kernel, _)| kernel).chain([PROJECT_SUBGROUPS]);
        relighting.map(by_names).chain([by_names(TONE)])
    }

    /// Offsets of the members of a struct in a shader, and its size.
    fn members(source: &str, name: &str) -> Option<(Vec<(String, u32)>, u32)> {
        let module = naga::front::wgsl::parse_str(source).unwrap();
        module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(name)).map(|(_, ty)| match &ty.inner {
            naga::TypeInner::Struct { members, span } => {
                (members.iter().map(|m| (m.name.clone().unwrap(), m.offset)).collect(), *span)
            }
            other => panic!("{name} is {other:?}"),
        })
    }

    #[test]
    fn structs_of_the_shaders_have_the_layout_of_ours() {
        macro_rules! layout {
            ($ty:ident: $($field:ident),+) => {
                (stringify!($ty), vec![$((stringify!($field).to_owned(), offset_of!($ty, $field) as u32)),+],
                 size_of::<$ty>() as u32)
            };
        }
        let ours = [
            layout!(Sizes: columns, coefficients, components, blocks, sparse_rows),
            layout!(GpuComponent: first_cell, cells, left_word, is_narrow),
            layout!(GpuCell: word, lengths, first, scale),
            layout!(GpuBlock: first_component, component_count, pixels, first_pixel, id),
            layout!(SparseRow: target_index, first, end),
            layout!(GpuSparseEntry: column, value),
            layout!(Tone: gain, curve, width, side, low_stops, range_stops),
        ];
        for (name, fields, size) in ours {
            // The shaders have no other blocks.
            let name = name.trim_start_matches("Gpu");
            let found: Vec<_> = all_kernels().filter_map(|(_, source, _)| members(source, name)).collect();
            assert_eq!(found.len(), all_kernels().count(), "all shaders know {name}");
            found.iter().for_each(|found| assert_eq!(found, &(fields.clone(), size), "{name}"));
        }
    }

    #[test]
    fn shaders_are_valid_and_have_the_entry_points_and_bindings_that_are_made_for_them() {
        for (kernel, source, bound) in all_kernels() {
            let module = naga::front::wgsl::parse_str(source).unwrap();
            // Nothing beyond plain WebGPU, of which `unpack2x16float` is a part, and subgroups where they are offered.
            let subgroups = source == PROJECT_SUBGROUPS.source;
            let capabilities = naga::valid::Capabilities::SHADER_FLOAT16_IN_FLOAT32
                | if subgroups { naga::valid::Capabilities::SUBGROUP } else { naga::valid::Capabilities::empty() };
            let mut validator = naga::valid::Validator::new(naga::valid::ValidationFlags::all(), capabilities);
            validator.validate(&module).unwrap_or_else(|e| panic!("{kernel}: {e:?}"));
            assert_eq!(module.entry_points.len(), 1);
            assert_eq!(module.entry_points[0].name, kernel);
            assert_eq!(module.entry_points[0].workgroup_size, [THREADS, 1, 1]);
            let has = |name: &str, value: u32| source.contains(&format!("const {name}: u32 = {value}u;"));
            assert!(kernel != "project" || has("PLACE_BITS", PLACE_BITS), "{kernel}");
            let mut bindings: Vec<_> =
                module.global_variables.iter().filter_map(|(_, v)| v.binding.map(|b| (b.group, b.binding))).collect();
            bindings.sort_unstable();
            let expected: Vec<_> = (0..bound.len() as u32).map(|binding| (0, binding)).collect();
            assert_eq!(bindings, expected, "{kernel}");
            for (_, variable) in module.global_variables.iter() {
                if let Some(binding) = variable.binding {
                    let name = variable.name.as_deref().unwrap();
                    assert_eq!(bound[binding.binding as usize], name, "{kernel}");
                }
            }
        }
    }
}
