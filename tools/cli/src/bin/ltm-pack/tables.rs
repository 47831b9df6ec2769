//! The tables that `ltm-pack` prints.

use ltm::image::LayerRole;
use ltm::light::Job;
use ltm::light::column_name;
use ltm::pipeline::{BlockComparison, ImportedMatrix, WorstEntry, total_relative_l2};
use ltm_cli::console::plain;
use ltm_cli::say;
use ltm_cli::words::in_flags;

/// Blocks that the table of a comparison lists at most.
const MAX_BLOCKS: usize = 48;
/// Ignored layers that are named.
const MAX_IGNORED: usize = 12;

/// What each layer was taken for and whether the lights add up, where that is `wanted`, and what looks wrong in any case.
pub(crate) fn print_matches(matrix: &ImportedMatrix, wanted: bool) {
    if wanted {
        print_layers(matrix);
    }
    matrix.warnings.worded(in_flags).iter().for_each(|warning| eprintln!("warning: {}", plain(warning)));
}

fn print_layers(matrix: &ImportedMatrix) {
    let longest = matrix.matches.iter().map(|m| m.layer.chars().count()).max().unwrap_or(0).clamp(5, 48);
    let shown = |layer: &str| if layer.is_empty() { "(R, G, B)".to_owned() } else { layer.to_owned() };
    say!("{:<longest$}  taken for", "layer");
    for found in &matrix.matches {
        match &found.role {
            LayerRole::Light(light) => say!("{:<longest$}  light '{light}'", shown(&found.layer)),
            LayerRole::Sum => say!("{:<longest$}  all lights together", shown(&found.layer)),
            LayerRole::Ignored => {}
        }
    }
    let ignored: Vec<_> =
        matrix.matches.iter().filter(|m| m.role == LayerRole::Ignored).map(|m| shown(&m.layer)).collect();
    if !ignored.is_empty() {
        let more = if ignored.len() > MAX_IGNORED { " …" } else { "" };
        say!("ignored: {}{more}", ignored[..ignored.len().min(MAX_IGNORED)].join(", "));
    }
    match matrix.sum_difference {
        Some(difference) => {
            say!("the lights' sum is {difference:.1e} (relative L2) from the image under all of them")
        }
        None => say!("no image under all lights: whether the lights add up cannot be checked"),
    }
}

/// The error of each block (of the worst ones, where there are many) and the worst place.
pub(crate) fn print_comparison(blocks: &[BlockComparison], job: &Job) {
    let mut order: Vec<&BlockComparison> = blocks.iter().collect();
    if blocks.len() > MAX_BLOCKS {
        order.sort_by(|a, b| b.relative_l2().total_cmp(&a.relative_l2()).then(a.id.cmp(&b.id)));
        say!("the {MAX_BLOCKS} blocks of largest relative error, of {}:", blocks.len());
    }
    say!("{:>6}  {:<18} {:>11}  largest difference", "block", "pixels", "relative L2");
    for block in order.iter().take(MAX_BLOCKS) {
        let rect = block.rect;
        let pixels = format!("{},{},{}x{}", rect.x, rect.y, rect.width, rect.height);
        say!("{:>6}  {pixels:<18} {:>11.2e}  {}", block.id.0, block.relative_l2(), place(&block.worst, job));
    }
    let worst = blocks.iter().map(|block| &block.worst).max_by(|a, b| a.difference().total_cmp(&b.difference()));
    say!("whole matrix: relative L2 {:.3e}, over {} blocks", total_relative_l2(blocks), blocks.len());
    if let Some(worst) = worst {
        say!("worst place: {}", place(worst, job));
    }
}

fn place(place: &WorstEntry, job: &Job) -> String {
    let WorstEntry { x, y, source, packed, .. } = place;
    let channel = ["red", "green", "blue"][place.channel];
    format!(
        "{:.2e} at pixel {x},{y} {channel}, light {}: {source:.4e} became {packed:.4e}",
        place.difference(),
        column_name(place.column, &job.basis)
    )
}
