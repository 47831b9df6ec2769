//! Files as people have them: what each input format's dialects, quirks and faults make, beside the right value. The table
//! `formats/inputs.md` says the same for people, and is compared with what is tested here. Collections of files are read where
//! `LTM_CASES` names their folder; elsewhere those tests are listed as ignored.

#[path = "cases/gltf.rs"]
mod gltf;
#[path = "cases/images.rs"]
mod images;
#[path = "cases/mtl.rs"]
mod mtl;
#[path = "cases/obj.rs"]
mod obj;
#[path = "cases/photometry.rs"]
mod photometry;
#[path = "cases/rays.rs"]
mod rays;
#[path = "cases/reference.rs"]
mod reference;
#[path = "cases/room.rs"]
mod room;
#[path = "cases/units.rs"]
mod units;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use libtest_mimic::{Arguments, Trial};

/// What becomes of an input, as `formats/inputs.md` says it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    /// It means what its author meant, without a word.
    Read,
    /// It is brought to what the engine computes with, which a line says where it could surprise.
    Converted,
    /// It is read but for something that a warning names.
    Warned,
    /// It is refused in one line that says what to do.
    Refused,
}

impl Outcome {
    fn word(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Converted => "converted",
            Self::Warned => "warned",
            Self::Refused => "refused",
        }
    }
}

/// A row of the table in `formats/inputs.md` and its test.
struct Case {
    /// The heading of the table: `OBJ`, `MTL`, `glTF`, `IES`, `EULUMDAT`, `Radiance HDR`, `OpenEXR`, `NumPy`, `Files by the number`.
    format: &'static str,
    /// The first cell of the row.
    input: &'static str,
    /// The second cell of the row.
    outcome: Outcome,
    test: fn(),
}

/// A test of a folder of `LTM_CASES`.
struct Collection {
    folder: &'static str,
    test: fn(&Path),
}

fn cases() -> impl Iterator<Item = &'static Case> {
    [gltf::CASES, images::CASES, mtl::CASES, obj::CASES, photometry::CASES].into_iter().flatten()
}

/// Each row of the table has a test that says the same, and each test a row.
fn the_table_says_what_is_tested() {
    let text = std::fs::read_to_string("formats/inputs.md").expect("formats/inputs.md");
    let mut said = BTreeSet::new();
    let mut format = "";
    for line in text.lines() {
        if let Some(heading) = line.strip_prefix("## ") {
            format = heading;
        }
        let cells: Vec<&str> = line.trim_matches('|').split(" | ").map(str::trim).collect();
        if line.starts_with("| ") && cells.len() == 3 && cells[0] != "input" {
            assert!(said.insert((format, cells[0], cells[1])), "{format}: two rows of {}", cells[0]);
        }
    }
    let tested: BTreeSet<_> = cases().map(|case| (case.format, case.input, case.outcome.word())).collect();
    assert_eq!(tested.len(), cases().count(), "two cases of one input");
    let only = |a: &BTreeSet<_>, b: &BTreeSet<_>| format!("{:#?}", a.difference(b).collect::<Vec<_>>());
    assert!(
        said == tested,
        "rows without a test: {}\ntests without a row: {}",
        only(&said, &tested),
        only(&tested, &said)
    );
}

fn main() -> ExitCode {
    let own = |name: String, test: fn()| {
        Trial::test(name, move || {
            test();
            Ok(())
        })
    };
    let mut trials = vec![own("the_table_says_what_is_tested".into(), the_table_says_what_is_tested)];
    trials.extend(cases().map(|case| own(format!("{}: {}", case.format, case.input), case.test)));
    trials.extend(rays::TESTS.iter().chain(units::TESTS).map(|&(name, test)| own(name.into(), test)));
    trials.push(own("every OBJ file of these cases by tobj".into(), reference::own_files));
    let root = std::env::var_os("LTM_CASES").map(PathBuf::from);
    let all = root.clone();
    let by_tobj = Trial::test("every OBJ file of the collections by tobj", move || {
        reference::files_of_collections(&all.expect("ignored without the folder"));
        Ok(())
    });
    trials.push(by_tobj.with_ignored_flag(root.is_none()));
    for collections in [
        gltf::COLLECTIONS,
        images::COLLECTIONS,
        mtl::COLLECTIONS,
        obj::COLLECTIONS,
        photometry::COLLECTIONS,
        rays::COLLECTIONS,
        units::COLLECTIONS,
    ] {
        for &Collection { folder, test } in collections {
            let path = root.as_ref().map(|root| root.join(folder));
            let trial = Trial::test(format!("collection {folder}"), move || {
                test(&path.expect("ignored without the folder"));
                Ok(())
            });
            trials.push(trial.with_ignored_flag(root.is_none()));
        }
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit_code()
}
