//! `ltm info`.

use std::path::{Path, PathBuf};

use clap::Args;
use ltm::Result;
use ltm::container::ContainerReader;
use ltm::light::Job;
use ltm::pipeline::human_bytes;
use ltm::store::StoreReader;

use crate::input::{Kind, kind_of};

#[derive(Args)]
pub(crate) struct Info {
    /// The file.
    file: PathBuf,
}

pub(crate) fn run(options: &Info) -> Result<()> {
    let path = &*options.file;
    match kind_of(path)? {
        Kind::Container => {
            let container = ContainerReader::open(path)?;
            print_job(path, container.job());
            println!("size         {}", human_bytes(container.file_bytes()));
            let ratio = container.job().shape.raw_bytes() as f64 / container.file_bytes() as f64;
            println!("ratio        {ratio:.0}× of f32");
        }
        Kind::Matrix => {
            let matrix = StoreReader::open(path)?;
            print_job(path, matrix.job());
            let shape = matrix.job().shape;
            let committed = shape.blocks().filter(|&id| matrix.is_committed(id)).count();
            println!("committed    {committed} of {} blocks", shape.block_count());
            println!("size         {} on disk", human_bytes(matrix.stored_bytes()?));
        }
    }
    Ok(())
}

fn print_job(path: &Path, job: &Job) {
    let shape = job.shape;
    println!("{}", path.display());
    println!("source       {} ({})", job.provenance.source, job.provenance.program);
    println!("settings     {}", job.provenance.settings);
    println!("job          {}", job.hash());
    println!("image        {} × {} pixels", shape.width(), shape.height());
    println!(
        "matrix       {} rows × {} columns, {} in f32",
        shape.rows(),
        shape.columns(),
        human_bytes(shape.raw_bytes())
    );
    println!("blocks       {} of {side} × {side} pixels", shape.block_count(), side = shape.block_side());
    println!("lights       {}", job.basis.lights().len());
    for light in job.basis.lights().iter().take(40) {
        let (across, down) = light.layout();
        println!(
            "  {:<24} {across} × {down}  {:?}, emission {:?} {:?}",
            light.name, light.kind, light.emission, light.unit
        );
    }
}
