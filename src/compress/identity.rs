//! Stable names of settings. They identify a pack and are stored in containers.

use super::{CompressSettings, Core, PriorChoice, Ranks, Scope, Target};

impl CompressSettings {
    /// These settings as `name=value` pairs in a fixed order. Programs and files compare it, so the names stay whatever
    /// fields are called. Numbers are printed in the shortest form that parses to the same value.
    pub fn identity(&self) -> String {
        // Destructured, so that a new field cannot be forgotten.
        let Self {
            method,
            target,
            prior,
            rank,
            ranks,
            oversampling,
            power_iterations,
            columns_per_round,
            rows_per_column,
            rounds,
            kmeans_iterations,
            scope,
            sample_rows,
            core,
            truncation,
            sparse,
            by_eye,
            exposure_exponent,
            noise_factor,
            seed,
        } = self;
        let none = || "none".to_owned();
        let columns_per_round = columns_per_round.map_or_else(none, |columns| columns.to_string());
        let sparse = sparse.map_or_else(none, |rule| format!("{}/{}", rule.fraction, rule.contrast));
        let noise_factor = noise_factor.map_or_else(none, |factor| factor.to_string());
        format!(
            "method={} target={} prior={} rank={rank} ranks={} oversampling={oversampling} power={power_iterations} \
             columns_per_round={columns_per_round} rows_per_column={rows_per_column} rounds={rounds} kmeans={kmeans_iterations} \
             scope={} sample_rows={sample_rows} core={} truncation={truncation} sparse={sparse} exposure={exposure_exponent} \
             noise={noise_factor} seed={seed}{}",
            method.name(),
            of_target(*target),
            prior.identity(),
            match ranks {
                Ranks::Fixed => "fixed",
                Ranks::ByRate => "rate",
            },
            match scope {
                Scope::Block => "block",
                Scope::Global => "global",
            },
            match core {
                Core::Textbook => "textbook",
                Core::LeastSquares => "least-squares",
                Core::Projection => "projection",
            },
            if *by_eye { " by_eye" } else { "" },
        )
    }
}

impl PriorChoice {
    /// A stable name.
    pub fn identity(self) -> &'static str {
        match self {
            Self::Lighting => "lighting",
            Self::Flat => "flat",
        }
    }
}

fn of_target(target: Target) -> String {
    match target {
        Target::Automatic => "automatic".to_owned(),
        Target::PsnrDb(db) => format!("{db}dB"),
        Target::RelativeL2(error) => format!("relative:{error}"),
        Target::Bytes(bytes) => format!("{bytes}B"),
        Target::Slope(slope) => format!("slope:{slope}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// These names are stored in files: changing one changes the identity of packs.
    #[test]
    fn the_words_of_the_default_never_change() {
        assert_eq!(
            CompressSettings::default().identity(),
            "method=auto target=automatic prior=lighting rank=24 ranks=fixed oversampling=8 power=1 columns_per_round=none \
             rows_per_column=2 rounds=4 kmeans=8 scope=block sample_rows=65536 core=least-squares truncation=0.01 sparse=0.02/16 \
             exposure=0.25 noise=4 seed=0"
        );
        let other = CompressSettings { target: Target::RelativeL2(1e-3), sparse: None, ..Default::default() };
        assert!(other.identity().contains("target=relative:0.001 ") && other.identity().contains(" sparse=none "));
    }
}
