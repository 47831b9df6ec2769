//! Relights a container: every light on its scene's value but one, which is turned off.
//!
//! `cargo run --release --example relight -- room.ltc lamp out.exr`

use std::path::Path;

use ltm::container::ContainerReader;
use ltm::image::write_exr;
use ltm::light::Lighting;
use ltm::relight::CpuRelighter;

fn main() -> ltm::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [container, name, image] = arguments.as_slice() else {
        return Err(ltm::Error::input("arguments", "not three of them", "give a container, a light's name, an image"));
    };
    let container = ContainerReader::open(Path::new(container))?;
    let basis = &container.job().basis;
    let off = basis
        .find(name)
        .ok_or_else(|| ltm::Error::input(name, "is no light of this container", "`ltm info` lists them"))?
        .columns();

    let mut weights = Lighting::of_scene(basis).weights().to_vec();
    weights[off.start as usize..off.end as usize].fill([0.0; 3]);

    // The factors are read once; each relighting after that is one product.
    let relighter = CpuRelighter::load(&container)?;
    write_exr(Path::new(image), &relighter.relight(&Lighting::new(weights)?)?)
}
