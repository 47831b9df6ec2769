//! What the numbers were measured on.

use std::fs;

/// Processor, cores and memory of this machine, as far as it tells, and the program.
pub(super) fn describe() -> String {
    let field = |path: &str, key: &str| -> Option<String> {
        let text = fs::read_to_string(path).ok()?;
        let line = text.lines().find(|line| line.starts_with(key))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    };
    let processor = field("/proc/cpuinfo", "model name").unwrap_or_else(|| std::env::consts::ARCH.to_owned());
    let kibibytes =
        field("/proc/meminfo", "MemTotal").and_then(|v| v.trim_end_matches("kB").trim().parse::<f64>().ok());
    let memory = kibibytes.map_or(String::new(), |kib| format!(", {:.0} GiB", kib / (1 << 20) as f64));
    let build = if cfg!(debug_assertions) { ", development build" } else { "" };
    format!("{processor}, {} threads{memory}; ltm {}{build}", rayon::current_num_threads(), env!("CARGO_PKG_VERSION"))
}

/// The commit that the program was built from, where it is known.
pub(super) fn commit() -> Option<&'static str> {
    Some(env!("LTM_COMMIT")).filter(|commit| !commit.is_empty())
}

/// What else the machine had to do, as far as it tells: processes that wanted to run in the last minute.
pub(super) fn load() -> String {
    let text = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    match text.split_whitespace().next() {
        Some(load) => format!("Load when it began: {load}."),
        None => String::new(),
    }
}
