//! The figures of a benchmark as a table: `NAME.csv` in the folder `tmp/figures` of the build, to be published in `docs/plots`.

use std::ffi::OsStr;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Figures of one run.
pub(crate) struct Figures {
    name: &'static str,
    text: String,
}

impl Figures {
    /// For a file of this name. What prints them is `cargo`, with those of the environment's variables that it reads.
    pub(crate) fn new(name: &'static str, variables: &[&str], cargo: &str) -> Self {
        let said = |name: &&str| Some(format!("{name}={} ", typed(&std::env::var_os(name)?)));
        let said: String = variables.iter().filter_map(said).collect();
        let told = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let model = told.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
        let processor = model.map_or(std::env::consts::ARCH, |(_, model)| model);
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let text = format!(
            "# {name}\n# Command: `{said}{cargo}`.\n# Machine: {processor}, {threads} threads.\n# Built from commit {}.\n\
             case,figure,value\n",
            commit(),
        );
        Self { name, text }
    }

    /// A value, of one of several cases, under its name with the unit last.
    pub(crate) fn add(&mut self, case: &str, figure: &str, value: f64) {
        self.text += &format!("\"{case}\",{figure},{value}\n");
    }

    /// Writes the table, and says where.
    pub(crate) fn write(self) {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("figures");
        let path = folder.join(self.name).with_extension("csv");
        fs::create_dir_all(&folder)
            .and_then(|()| fs::write(&path, self.text))
            .expect("the build's folder can be written");
        eprintln!("{}", path.display());
    }
}

/// The commit that is checked out, which `cargo` builds a benchmark from when it is run; `unknown` without `git`.
fn commit() -> String {
    let said =
        Command::new("git").args(["rev-parse", "--short=10", "HEAD"]).current_dir(env!("CARGO_MANIFEST_DIR")).output();
    let said = said.ok().filter(|said| said.status.success()).and_then(|said| String::from_utf8(said.stdout).ok());
    said.map_or_else(|| "unknown".to_owned(), |commit| commit.trim().to_owned())
}

/// A variable's value as it is typed in the folder of the files that it names, with `:` between them.
fn typed(value: &OsStr) -> String {
    let typed = |path: std::path::PathBuf| match (path.is_absolute(), path.file_name()) {
        (true, Some(name)) => format!("$PWD/{}", name.display()),
        _ => path.display().to_string(),
    };
    std::env::split_paths(value).map(typed).collect::<Vec<_>>().join(":")
}
