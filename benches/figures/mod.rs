//! The figures of a benchmark as a table: `NAME.csv` in the folder `tmp/figures` of the build, to be published in `formats/plots`.

use std::fs;
use std::path::Path;

/// Figures of one run.
pub(crate) struct Figures {
    name: &'static str,
    text: String,
}

impl Figures {
    /// For a file of this name. The command is what prints them.
    pub(crate) fn new(name: &'static str, command: &str) -> Self {
        let told = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let model = told.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
        let processor = model.map_or(std::env::consts::ARCH, |(_, model)| model);
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let text = format!(
            "# {name}\n# Command: `{command}`.\n# Machine: {processor}, {threads} threads.\ncase,figure,value\n"
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
