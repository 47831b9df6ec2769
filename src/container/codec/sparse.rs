//! Sparse entries: their places in column order, the channels of a pixel together, values predicted from neighbours.

use super::adaptive::{BitCoder, BitDecoder, BitEncoder, Context, NumberContexts, SignedContexts};
use crate::matrix::{CHANNELS, ColumnIndex, SparseEntry};

/// Largest magnitude of a quantised value.
pub(super) const MAX_VALUE: i32 = 1 << 24;

/// The entries of one pixel under one column.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Group {
    column: u32,
    pixel: u32,
    /// Bit `c` for channel `c`.
    mask: u32,
    values: [i32; CHANNELS],
}

#[derive(Default)]
struct Contexts {
    column: NumberContexts,
    gap: [NumberContexts; 3],
    start: SignedContexts,
    mask: [[Context; 8]; 8],
    first: SignedContexts,
    others: SignedContexts,
}

/// State that both directions keep: contexts, the group before, and the first pixel of its column.
#[derive(Default)]
struct SparseWalk {
    contexts: Contexts,
    before: Option<Group>,
    column_start: u32,
    last_gap: u32,
}

impl SparseWalk {
    /// Writes `group`, or reads one (and ignores the argument). `None` where the numbers overflow.
    fn step(&mut self, coder: &mut impl BitCoder, group: Group) -> Option<Group> {
        let before = self.before.unwrap_or_default();
        let contexts = &mut self.contexts;
        let advance = coder.number(&mut contexts.column, group.column.wrapping_sub(before.column));
        let column = before.column.checked_add(advance)?;
        let pixel = if advance == 0 && self.before.is_some() {
            let kind = (32 - self.last_gap.leading_zeros()).min(2) as usize;
            let gap = coder.number(&mut contexts.gap[kind], group.pixel.wrapping_sub(before.pixel).wrapping_sub(1));
            self.last_gap = gap;
            before.pixel.checked_add(gap)?.checked_add(1)?
        } else {
            let delta = coder.signed(&mut contexts.start, group.pixel.wrapping_sub(self.column_start) as i32);
            self.column_start = self.column_start.checked_add_signed(delta)?;
            self.last_gap = 0;
            self.column_start
        };
        let mut mask = 0;
        for c in 0..CHANNELS {
            let context = &mut contexts.mask[before.mask as usize][mask as usize | (1 << c) >> 1];
            mask |= u32::from(coder.bit(context, group.mask >> c & 1 == 1)) << c;
        }
        let mut values = before.values;
        let mut first: Option<usize> = None;
        for c in (0..CHANNELS).filter(|c| mask >> c & 1 == 1) {
            let guess = match first {
                Some(f) => values[f].checked_add(before.values[c])?.checked_sub(before.values[f])?,
                None => before.values[c],
            };
            let contexts = if first.is_some() { &mut contexts.others } else { &mut contexts.first };
            let delta = coder.signed(contexts, group.values[c].wrapping_sub(guess));
            values[c] = guess.checked_add(delta).filter(|v| v.abs() <= MAX_VALUE)?;
            first = first.or(Some(c));
        }
        let group = Group { column, pixel, mask, values };
        self.before = Some(group);
        Some(group)
    }
}

/// Writes entries, quantised with `step`.
pub(super) fn write(coder: &mut BitEncoder, entries: &[SparseEntry], pixels: usize, step: f32) {
    let mut groups: Vec<Group> = Vec::new();
    let mut sorted: Vec<(u32, u32, u32, i32)> = entries
        .iter()
        .map(|e| {
            let value = ((e.value / step).round() as i32).clamp(-MAX_VALUE, MAX_VALUE);
            (e.column.0, e.row % pixels as u32, e.row / pixels as u32, value)
        })
        .collect();
    sorted.sort_unstable();
    for (column, pixel, channel, value) in sorted {
        match groups.last_mut() {
            Some(group) if (group.column, group.pixel) == (column, pixel) => {
                group.mask |= 1 << channel;
                group.values[channel as usize] = value;
            }
            _ => {
                let mut group = Group { column, pixel, mask: 1 << channel, values: [0; CHANNELS] };
                group.values[channel as usize] = value;
                groups.push(group);
            }
        }
    }
    let mut walk = SparseWalk::default();
    for group in groups {
        walk.step(coder, group).expect("sizes inside a block do not overflow");
    }
}

/// Reads `count` entries of a block of `pixels` and `columns`, sorted by column, then row.
pub(super) fn read(
    coder: &mut BitDecoder<'_>,
    count: usize,
    pixels: usize,
    columns: usize,
    step: f32,
) -> Result<Vec<SparseEntry>, String> {
    let mut entries = Vec::new();
    // Entries come by column, then pixel; of each column, those of later channels wait until it ends.
    let mut waiting: [Vec<SparseEntry>; CHANNELS - 1] = Default::default();
    let mut column = 0;
    let mut read = 0;
    let mut walk = SparseWalk::default();
    while read < count {
        let group = walk
            .step(coder, Group::default())
            .filter(|g| (g.pixel as usize) < pixels && (g.column as usize) < columns && g.mask != 0)
            .ok_or("a sparse entry stands outside the block")?;
        if coder.is_exhausted() {
            return Err("the sparse entries are cut short".into());
        }
        if group.column != column {
            column = group.column;
            waiting.iter_mut().for_each(|waiting| entries.append(waiting));
        }
        for c in (0..CHANNELS).filter(|c| group.mask >> c & 1 == 1) {
            let row = c as u32 * pixels as u32 + group.pixel;
            let entry = SparseEntry { column: ColumnIndex(column), row, value: group.values[c] as f32 * step };
            if c == 0 {
                entries.push(entry)
            } else {
                waiting[c - 1].push(entry)
            }
            read += 1;
        }
    }
    waiting.iter_mut().for_each(|waiting| entries.append(waiting));
    if read != count {
        return Err("there are more sparse entries than stated".into());
    }
    // Only of damaged bytes.
    if !entries.is_sorted_by_key(|entry| (entry.column, entry.row)) {
        entries.sort_unstable_by_key(|entry| (entry.column, entry.row));
    }
    Ok(entries)
}
