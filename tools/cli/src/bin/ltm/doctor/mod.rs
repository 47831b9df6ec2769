//! `ltm doctor`: the machine, what of it the programs can use, and what is missing for what, in one line each.

mod machine;
mod neighbours;

use ltm::Result;
use ltm_cli::say;

/// What was found out about one thing.
struct Finding {
    label: &'static str,
    found: String,
    /// What does not work for want of it, and what to do about it.
    missing: Option<String>,
}

impl Finding {
    fn of(label: &'static str, found: impl Into<String>) -> Self {
        Self { label, found: found.into(), missing: None }
    }

    fn without(label: &'static str, found: impl Into<String>, missing: impl Into<String>) -> Self {
        Self { label, found: found.into(), missing: Some(missing.into()) }
    }
}

/// Prints the findings, then a line for each thing that is missing.
pub(crate) fn run() -> Result<()> {
    let mut findings = vec![program()];
    findings.extend([machine::system(), machine::processor(), machine::memory(), machine::disk()]);
    findings.extend([machine::gpu(), machine::display()]);
    findings.extend(neighbours::programs());
    findings.extend([neighbours::python(), neighbours::blender()]);
    for finding in &findings {
        say!("{:<12} {}", finding.label, finding.found);
    }
    let missing: Vec<&String> = findings.iter().filter_map(|finding| finding.missing.as_ref()).collect();
    for missing in &missing {
        say!("{:<12} {missing}", "missing");
    }
    if missing.is_empty() {
        println!("{:<12} nothing", "missing");
    }
    Ok(())
}

/// This program: version, what it was built for and with, and where it lies.
fn program() -> Finding {
    let features = [("gpu", cfg!(feature = "gpu")), ("s3", cfg!(feature = "s3"))];
    let with =
        features.iter().filter(|(_, is_there)| *is_there).map(|(name, _)| *name).collect::<Vec<_>>().join(" and ");
    let with = if with.is_empty() { "neither gpu nor s3" } else { &with };
    let place = std::env::current_exe().map_or_else(|_| "unknown".to_owned(), |path| path.display().to_string());
    let (version, os, cpu) = (env!("CARGO_PKG_VERSION"), std::env::consts::OS, std::env::consts::ARCH);
    let built = if cfg!(debug_assertions) { ", built for debugging" } else { "" };
    Finding::of("ltm", format!("{version} for {os} on {cpu}, with {with}{built}, {place}"))
}
