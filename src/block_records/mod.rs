//! One byte string for each block: in a file beside a result that is not finished, or in shards that machines of a farm built.

mod records;
#[cfg_attr(not(feature = "scene"), expect(dead_code, reason = "only jobs of scenes are cut into shards"))]
mod shard;
mod spill;

pub(crate) use records::Records;
pub(crate) use shard::ShardSet;
#[cfg(feature = "scene")]
pub(crate) use shard::{Opener, Shard, ShardContent, ShardHead, hex, plan_prefix, range_prefix};
#[cfg(feature = "scene")]
pub(crate) use spill::spill_path;
pub(crate) use spill::{
    DENOISED, GATHERED, GATHERED_PARTS, files_of_pack, open_spill, remove_leftovers, stop_if_interrupted,
};
