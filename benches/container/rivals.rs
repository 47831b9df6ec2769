//! What the codec is held against: other transforms, predictions and entropy coders for the same quantised factors.
//!
//! All of them quantise uniformly with the steps that the block asks for, so that their errors are alike; the 16- and 8-bit
//! ones with a scale for each component do not know steps.

use std::sync::OnceLock;

use ltm::matrix::FactoredBlock;

/// Side of the little images.
pub(crate) const SIDE: usize = 32;
const AREA: usize = SIDE * SIDE;
/// Levels of the wavelet.
const LEVELS: usize = 4;

/// How values are changed before they are quantised.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Transform {
    None,
    /// Orthonormal DCT-II of whole images.
    Cosine,
    /// Cohen–Daubechies–Feauveau 9/7 by lifting, scaled to near orthonormality.
    Wavelet,
    /// The right sides less their best combination of the neighbour's, then the DCT.
    NeighbourCosine,
}

/// How quantised values become bytes.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Packing {
    /// 16-bit numbers as they are.
    Plain,
    /// Low bytes, then high bytes.
    Shuffled,
    /// Bit by bit of magnitude, highest plane first, then signs.
    Planes,
}

/// A block as bytes, with what decoding needs to know of it.
pub(crate) struct Packed {
    bytes: Vec<u8>,
    steps: Vec<f32>,
    transform: Transform,
    packing: Packing,
    /// The neighbour's right sides multiplied out, where they are predicted from.
    prediction: Vec<f32>,
    side_bytes: usize,
    rows: usize,
    columns: usize,
}

impl Packed {
    /// Bytes with steps, scales and coefficients of prediction, four each.
    pub(crate) fn bytes(&self) -> usize {
        self.bytes.len() + 4 * self.steps.len() + self.side_bytes
    }
}

/// The sides of a block as images, in the order of their steps: left and right of each component in turn.
fn images(block: &FactoredBlock) -> Vec<f32> {
    let sides = (0..block.rank()).flat_map(|k| [block.left_component(k), block.right_component(k)]);
    sides.flatten().copied().collect()
}

/// The block with larger steps.
pub(crate) fn coarser(block: &FactoredBlock, factor: f32) -> FactoredBlock {
    let mut block = block.clone();
    block.left_step.iter_mut().chain(&mut block.right_step).for_each(|step| *step *= factor);
    block
}

/// Encodes with the block's own steps.
pub(crate) fn encode(
    block: &FactoredBlock,
    neighbour: &FactoredBlock,
    transform: Transform,
    packing: Packing,
) -> Packed {
    let (rows, columns) = (block.rows, block.columns);
    let mut values = images(block);
    let steps: Vec<f32> = block.left_step.iter().zip(&block.right_step).flat_map(|(&l, &r)| [l, r]).collect();
    let (mut prediction, mut side_bytes) = (Vec::new(), 0);
    if transform == Transform::NeighbourCosine {
        (prediction, side_bytes) = predict(block, neighbour);
        for (k, guess) in prediction.chunks_exact(columns).enumerate() {
            let right = &mut values[k * (rows + columns) + rows..][..columns];
            right.iter_mut().zip(guess).for_each(|(v, g)| *v -= g);
        }
    }
    values.chunks_exact_mut(AREA).for_each(|image| forward(transform, image));
    let mut quantised: Vec<i16> = Vec::with_capacity(values.len());
    for (k, component) in values.chunks_exact(rows + columns).enumerate() {
        for (side, step) in [&component[..rows], &component[rows..]].into_iter().zip(&steps[2 * k..]) {
            quantised.extend(side.iter().map(|v| (v / step).round().clamp(-32767.0, 32767.0) as i16));
        }
    }
    let bytes = zstd::bulk::compress(&pack(&quantised, packing), 19).expect("compressing into memory cannot fail");
    Packed { bytes, steps, transform, packing, prediction, side_bytes, rows, columns }
}

/// Decodes to a block.
pub(crate) fn decode(packed: &Packed) -> FactoredBlock {
    let (rows, columns) = (packed.rows, packed.columns);
    let rank = packed.steps.len() / 2;
    let count = rank * (rows + columns);
    let plain = zstd::bulk::decompress(&packed.bytes, 8 * count + 64).expect("the bytes are sound");
    let mut values: Vec<f32> = unpack(&plain, count, packed.packing).into_iter().map(f32::from).collect();
    for (k, component) in values.chunks_exact_mut(rows + columns).enumerate() {
        component[..rows].iter_mut().for_each(|v| *v *= packed.steps[2 * k]);
        component[rows..].iter_mut().for_each(|v| *v *= packed.steps[2 * k + 1]);
    }
    values.chunks_exact_mut(AREA).for_each(|image| inverse(packed.transform, image));
    let mut block = FactoredBlock { rows, columns, ..Default::default() };
    for (k, component) in values.chunks_exact(rows + columns).enumerate() {
        block.left.extend(&component[..rows]);
        block.right.extend(&component[rows..]);
        if let Some(guess) = packed.prediction.chunks_exact(columns).nth(k) {
            block.right[k * columns..].iter_mut().zip(guess).for_each(|(v, g)| *v += g);
        }
    }
    block
}

/// Factors as signed numbers of 8 or 16 bits with a scale for each side of each component.
pub(crate) fn scaled(block: &FactoredBlock, bits: u32, packing: Packing) -> (usize, FactoredBlock) {
    let mut decoded = block.clone();
    let limit = ((1 << (bits - 1)) - 1) as f32;
    let (rows, columns) = (block.rows, block.columns);
    let mut quantised: Vec<i16> = Vec::new();
    let sides = decoded.left.chunks_exact_mut(rows).chain(decoded.right.chunks_exact_mut(columns));
    for values in sides {
        let scale = values.iter().fold(1e-30f32, |m, v| m.max(v.abs())) / limit;
        for value in values {
            let q = (*value / scale).round();
            *value = q * scale;
            quantised.push(q as i16);
        }
    }
    let bytes = match bits {
        8 => quantised.iter().map(|&q| q as i8 as u8).collect(),
        _ => pack(&quantised, packing),
    };
    (zstd::bulk::compress(&bytes, 19).expect("compressing into memory cannot fail").len() + 8 * block.rank(), decoded)
}

fn pack(values: &[i16], packing: Packing) -> Vec<u8> {
    match packing {
        Packing::Plain => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        Packing::Shuffled => {
            let zigzag = |v: i16| ((v << 1) ^ (v >> 15)) as u16;
            let byte = |shift: u32| values.iter().map(move |&v| (zigzag(v) >> shift) as u8);
            byte(0).chain(byte(8)).collect()
        }
        Packing::Planes => {
            let plane = |bit: &dyn Fn(i16) -> bool| {
                values.chunks(8).map(|v| v.iter().fold(0, |b, &v| b << 1 | u8::from(bit(v)))).collect::<Vec<_>>()
            };
            let mut bytes: Vec<u8> = (0..15).rev().flat_map(|p| plane(&|v| v.unsigned_abs() >> p & 1 == 1)).collect();
            bytes.extend(plane(&|v| v < 0));
            bytes
        }
    }
}

fn unpack(bytes: &[u8], count: usize, packing: Packing) -> Vec<i16> {
    match packing {
        Packing::Plain => bytes.chunks_exact(2).map(|b| i16::from_le_bytes([b[0], b[1]])).collect(),
        Packing::Shuffled => {
            let (low, high) = bytes.split_at(count);
            let value = |z: u16| (z >> 1) as i16 ^ -((z & 1) as i16);
            low.iter().zip(high).map(|(&l, &h)| value(u16::from_le_bytes([l, h]))).collect()
        }
        Packing::Planes => {
            let mut values = vec![0i16; count];
            let planes: Vec<&[u8]> = bytes.chunks_exact(count.div_ceil(8)).collect();
            for plane in &planes[..15] {
                for (group, bits) in values.chunks_mut(8).zip(*plane) {
                    let last = group.len() - 1;
                    group.iter_mut().enumerate().for_each(|(i, v)| *v = *v << 1 | i16::from(bits >> (last - i) & 1));
                }
            }
            for (group, bits) in values.chunks_mut(8).zip(planes[15]) {
                let last = group.len() - 1;
                group.iter_mut().enumerate().filter(|(i, _)| bits >> (last - i) & 1 == 1).for_each(|(_, v)| *v = -*v);
            }
            values
        }
    }
}

/// The right sides' best combinations of the neighbour's, and the bytes of their coefficients.
fn predict(block: &FactoredBlock, neighbour: &FactoredBlock) -> (Vec<f32>, usize) {
    // Right sides of the neighbour made orthonormal (Gram and Schmidt, in f64).
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for k in 0..neighbour.rank() {
        let mut v: Vec<f64> = neighbour.right_component(k).iter().map(|&v| f64::from(v)).collect();
        for b in &basis {
            let along: f64 = v.iter().zip(b).map(|(a, b)| a * b).sum();
            v.iter_mut().zip(b).for_each(|(v, b)| *v -= along * b);
        }
        let norm = v.iter().map(|v| v * v).sum::<f64>().sqrt();
        if norm > 0.0 {
            v.iter_mut().for_each(|v| *v /= norm);
            basis.push(v);
        }
    }
    let mut prediction = Vec::new();
    for k in 0..block.rank() {
        let right = block.right_component(k);
        let mut guess = vec![0.0f32; right.len()];
        for b in &basis {
            let along: f64 = right.iter().zip(b).map(|(&a, b)| f64::from(a) * b).sum();
            guess.iter_mut().zip(b).for_each(|(g, b)| *g += (along * b) as f32);
        }
        prediction.extend(guess);
    }
    // Two bytes for each coefficient would do.
    (prediction, 2 * basis.len() * block.rank())
}

fn forward(transform: Transform, image: &mut [f32]) {
    match transform {
        Transform::None => {}
        Transform::Cosine | Transform::NeighbourCosine => both_ways(image, |line| cosine(line, false)),
        Transform::Wavelet => {
            for level in 0..LEVELS {
                wavelet_level(image, SIDE >> level, [true, false], lift);
            }
        }
    }
}

fn inverse(transform: Transform, image: &mut [f32]) {
    match transform {
        Transform::None => {}
        Transform::Cosine | Transform::NeighbourCosine => both_ways(image, |line| cosine(line, true)),
        Transform::Wavelet => {
            for level in (0..LEVELS).rev() {
                wavelet_level(image, SIDE >> level, [false, true], unlift);
            }
        }
    }
}

fn both_ways(image: &mut [f32], line: impl Fn(&mut [f32; SIDE])) {
    for _ in 0..2 {
        image.as_chunks_mut::<SIDE>().0.iter_mut().for_each(&line);
        for y in 0..SIDE {
            for x in 0..y {
                image.swap(y * SIDE + x, x * SIDE + y);
            }
        }
    }
}

fn cosine(line: &mut [f32; SIDE], inverse: bool) {
    static COSINES: OnceLock<Vec<f32>> = OnceLock::new();
    let table = COSINES.get_or_init(|| {
        let entry = |u: usize, x: usize| {
            let scale = (if u == 0 { 1.0 } else { 2.0 } / SIDE as f64).sqrt();
            (scale * (std::f64::consts::PI * (x as f64 + 0.5) * u as f64 / SIDE as f64).cos()) as f32
        };
        (0..AREA).map(|i| entry(i / SIDE, i % SIDE)).collect()
    });
    let mut out = [0.0; SIDE];
    for (u, row) in table.as_chunks::<SIDE>().0.iter().enumerate() {
        if inverse {
            out.iter_mut().zip(row).for_each(|(out, c)| *out += c * line[u]);
        } else {
            out[u] = row.iter().zip(line.iter()).map(|(c, v)| c * v).sum();
        }
    }
    *line = out;
}

/// One level on the upper left `size × size` values: rows (`true`) and columns in the order given.
fn wavelet_level(image: &mut [f32], size: usize, order: [bool; 2], line: fn(&mut [f32])) {
    let mut buffer = vec![0.0; size];
    for along_rows in order {
        for i in 0..size {
            let at = |j: usize| if along_rows { i * SIDE + j } else { j * SIDE + i };
            (0..size).for_each(|j| buffer[j] = image[at(j)]);
            line(&mut buffer);
            (0..size).for_each(|j| image[at(j)] = buffer[j]);
        }
    }
}

/// Lifting steps of the 9/7 wavelet (Daubechies and Sweldens, *Factoring wavelet transforms into lifting steps*, 1998).
const STEPS: [f32; 4] = [-1.586_134_3, -0.052_980_12, 0.882_911_1, 0.443_506_85];
const GAIN: f32 = 1.149_604_4;

/// Low half, then high half. The mirrored neighbour stands in at the ends.
fn lift(line: &mut [f32]) {
    for (i, step) in STEPS.into_iter().enumerate() {
        lifting(line, (i + 1) % 2, step);
    }
    let low: Vec<f32> = line.iter().step_by(2).map(|v| v * GAIN).collect();
    let high: Vec<f32> = line.iter().skip(1).step_by(2).map(|v| v / GAIN).collect();
    line[..low.len()].copy_from_slice(&low);
    line[low.len()..].copy_from_slice(&high);
}

fn unlift(line: &mut [f32]) {
    let (low, high) = line.split_at(line.len() / 2);
    let whole: Vec<f32> = low.iter().zip(high).flat_map(|(l, h)| [l / GAIN, h * GAIN]).collect();
    line.copy_from_slice(&whole);
    for (i, step) in STEPS.into_iter().enumerate().rev() {
        lifting(line, (i + 1) % 2, -step);
    }
}

fn lifting(line: &mut [f32], first: usize, step: f32) {
    let last = line.len() - 1;
    for i in (first..line.len()).step_by(2) {
        let before = line[if i == 0 { 1 } else { i - 1 }];
        let after = line[if i == last { last - 1 } else { i + 1 }];
        line[i] += step * (before + after);
    }
}
