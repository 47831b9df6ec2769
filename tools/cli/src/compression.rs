//! How to compress, as arguments: of `ltm-pack`, of `ltm render --pack` and of `ltm plan`; and what came of it.

use clap::{Args, ValueEnum};
use ltm::compress::{CompressSettings, Method, PriorChoice, Scope, Target};
use ltm::light::{LightBasis, denoise_errors_line, light_errors_lines};
use ltm::pipeline::PackReport;
use ltm::resources::parse_bytes;

use crate::say;

/// The options under the heading "Compression".
#[derive(Args, Clone)]
#[command(next_help_heading = "Compression")]
pub struct Compression {
    /// auto, algorithm1 … algorithm4, proposed (blocks, Algorithm 4, Nyström), pca or svd.
    #[arg(long, default_value = "auto")]
    method: Method,
    /// What to reach over the image: 45dB (PSNR of exposed images, whatever lamps are in view), 0.01 (relative L2) or 2MiB
    /// (bytes of the file). The noise of the samples may stop it earlier [default: 62dB for denoised images, under each light
    /// alone as well, with steps as the eye resolves them; for others as far as that noise, 50dB at most; 45dB where it is not known].
    #[arg(long, value_parser = parse_target)]
    target: Option<Target>,
    /// Components of a block at most; the rank itself for the methods other than auto [default: 64 for
    /// denoised images, else the method's].
    #[arg(long)]
    rank: Option<usize>,
    /// Whether algorithm1 … algorithm4 choose rows and columns for each block, or once for the whole matrix, which is then
    /// read up to five times and must be stored.
    #[arg(long, value_enum, default_value = "block")]
    scope: ScopeName,
    /// What errors are weighed by: how people light, or flat for plain least squares over all columns.
    #[arg(long, value_enum, default_value = "lighting")]
    prior: Prior,
    /// Follow the matrix to the target through its noise, instead of stopping where more bytes would only store noise.
    #[arg(long)]
    keep_noise: bool,
    /// Whether the grain of the samples is taken out of the images before they are compressed: auto does so where the samples
    /// were kept apart, unless --keep-noise or another method is asked for.
    #[arg(long, value_enum, default_value = "auto")]
    denoise: Denoise,
    /// Seed of the compression's random choices.
    #[arg(long, default_value_t = 0)]
    compression_seed: u64,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Denoise {
    Auto,
    Off,
}

#[derive(Clone, Copy, ValueEnum)]
enum Prior {
    Lighting,
    Flat,
}

#[derive(Clone, Copy, ValueEnum)]
enum ScopeName {
    Block,
    Global,
}

impl Compression {
    /// Whether images are to be denoised.
    pub fn denoise(&self) -> bool {
        self.denoise == Denoise::Auto
    }

    /// These as arguments of a command line.
    pub fn arguments(&self) -> Vec<String> {
        let mut arguments = Vec::new();
        let mut say = |name: &str, value: String| arguments.extend([name.to_owned(), value]);
        say("--method", self.method.to_string());
        say("--compression-seed", self.compression_seed.to_string());
        match self.target {
            Some(Target::PsnrDb(db)) => say("--target", format!("{db}dB")),
            Some(Target::RelativeL2(error)) => say("--target", error.to_string()),
            Some(Target::Bytes(bytes)) => say("--target", format!("{bytes}B")),
            // No command line asks for others.
            Some(Target::Slope(_) | Target::Automatic) | None => {}
        }
        self.rank.into_iter().for_each(|rank| say("--rank", rank.to_string()));
        let name =
            |value: Option<clap::builder::PossibleValue>| value.map_or_else(String::new, |v| v.get_name().to_owned());
        say("--scope", name(self.scope.to_possible_value()));
        say("--prior", name(self.prior.to_possible_value()));
        say("--denoise", name(self.denoise.to_possible_value()));
        arguments.extend(self.keep_noise.then(|| "--keep-noise".to_owned()));
        arguments
    }

    /// What they mean.
    pub fn settings(&self) -> CompressSettings {
        let mut settings = CompressSettings::of_method(self.method);
        settings.target = self.target.unwrap_or(settings.target);
        settings.rank = self.rank.unwrap_or(settings.rank);
        settings.seed = self.compression_seed;
        settings.scope = match self.scope {
            ScopeName::Block => Scope::Block,
            ScopeName::Global => Scope::Global,
        };
        settings.prior = match self.prior {
            Prior::Lighting => PriorChoice::Lighting,
            Prior::Flat => PriorChoice::Flat,
        };
        if self.keep_noise {
            settings.noise_factor = None;
        }
        settings
    }
}

fn parse_target(text: &str) -> Result<Target, String> {
    let number = |s: &str| s.trim().parse::<f64>().map_err(|_| format!("'{s}' is not a number"));
    if let Some(decibels) = text.strip_suffix("dB").or_else(|| text.strip_suffix("db")) {
        return number(decibels).map(Target::PsnrDb);
    }
    match text.parse::<f64>() {
        Ok(error) if error < 1.0 => Ok(Target::RelativeL2(error)),
        Ok(_) => Err(format!("'{text}' has no unit; write {text}dB, {text}MiB, or an error below 1 as 0.01")),
        _ => parse_bytes(text).map(Target::Bytes).map_err(|e| format!("{e}; or a PSNR, 45dB, or an error, 0.01")),
    }
}

/// Says what denoising did, where images were denoised, and what lightings of every kind lose.
pub fn say_errors(report: &PackReport, basis: &LightBasis) {
    report.denoising.iter().for_each(|errors| say!("{}", denoise_errors_line(errors)));
    light_errors_lines(&report.lights, basis).iter().for_each(|line| say!("{line}"));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        compression: Compression,
    }

    #[test]
    fn arguments_mean_what_they_were_made_from() {
        use clap::Parser;
        let lines = [
            "",
            "--target 45.5dB --rank 7 --denoise off",
            "--target 2MiB --prior flat",
            "--target 0.01 --keep-noise",
            "--method svd --compression-seed 3",
        ];
        for line in lines {
            let parse = |arguments: Vec<String>| {
                Line::parse_from(std::iter::once("ltm".to_owned()).chain(arguments)).compression
            };
            let typed = parse(line.split_whitespace().map(str::to_owned).collect());
            let again = parse(typed.arguments());
            assert_eq!(format!("{:?}", again.settings()), format!("{:?}", typed.settings()), "{line}");
            assert_eq!(again.denoise(), typed.denoise(), "{line}");
        }
    }

    #[test]
    fn a_target_says_what_it_counts() {
        assert_eq!(parse_target("45dB"), Ok(Target::PsnrDb(45.0)));
        assert_eq!(parse_target("0.01"), Ok(Target::RelativeL2(0.01)));
        assert_eq!(parse_target("2MiB"), Ok(Target::Bytes(2 << 20)));
        assert_eq!(parse_target("100B"), Ok(Target::Bytes(100)));
        for bare in ["45", "1", "1000000"] {
            let error = parse_target(bare).unwrap_err();
            assert!(error.contains(&format!("{bare}dB")), "{error}");
        }
    }
}
