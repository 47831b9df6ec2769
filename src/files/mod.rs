//! Files: how every other module writes, continues, locks and opens them.
//!
//! Three kinds of file are written, and nothing else:
//!
//! - A [`Replacement`] grows under a private temporary name in the folder of the final one and is moved there whole. Until then the
//!   old file stands; a failed or killed write changes nothing.
//! - A *partial file* grows under a visible name, `NAME.part`, locked, and is given its name by [`publish`] (the store's).
//! - A [`ContinuationFile`] keeps checked records from which a stopped job goes on. It refuses a file that is not its own.
//!
//! One rule for locks, [`open_locked`]: whoever writes a file that a second process could find holds its lock for as long as it is
//! open. Where the file system knows no locks the job goes on, and says so once ([`tell_missing_locks`]).
//!
//! What is [`Ranged`] is read where it is wanted, wherever it lies.
//!
//! A [`FileAccess`] says which files a document of someone else may have opened.
//!
//! What each system does in its own way is in `system`.
//!
//! New files have the permissions that the umask leaves, and never more than the file that they replace.

mod access;
mod continuation;
mod csv;
mod input;
mod lock;
mod names;
mod ranged;
mod replace;
mod space;
mod system;

pub use access::{FileAccess, LIBRARY_VARIABLE, library_folder};
pub use continuation::ContinuationFile;
pub use csv::{csv_field, csv_quoted};
pub use input::{open_input, read_input, read_input_text};
pub use lock::{open_locked, tell_missing_locks};
pub use names::{check_output, folder_of, natural_order, sync_folder, with_suffix};
pub use ranged::Ranged;
pub use replace::{Replacement, publish, replace, write_file};
pub use space::{check_free_space, free_bytes};
pub(crate) use system::{PositionedFile, allocated_bytes};
