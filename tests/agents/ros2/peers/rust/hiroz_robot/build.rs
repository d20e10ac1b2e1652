//! Generates types of which hiroz has none, each package from the last folder that has it.
use std::{collections::BTreeMap, env, fs, path::PathBuf};

fn main() -> anyhow::Result<()> {
    let humble = env::var("CARGO_FEATURE_HUMBLE").is_ok();
    let here = PathBuf::from(env::var("CARGO_MANIFEST_DIR")?).join("../..").canonicalize()?;
    let mut packages = BTreeMap::new();
    let folders = ["interfaces_of_tests", "interfaces", "interfaces_of_humble"];
    for folder in &folders[..if humble { 3 } else { 2 }] {
        println!("cargo:rerun-if-changed={}", here.join(folder).display());
        for package in fs::read_dir(here.join(folder))? {
            let package = package?;
            packages.insert(package.file_name(), package.path());
        }
    }
    // SAFETY: a build script has one thread.
    unsafe { env::set_var("HIROZ_MSG_PATH", env::join_paths(packages.values())?) };
    hiroz_codegen::generate_user_messages(&PathBuf::from(env::var("OUT_DIR")?), humble)
}
