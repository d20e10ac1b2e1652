//! Generates the types of `../../interfaces`, of which hiroz has none.
use std::{env, fs, path::PathBuf};

fn main() -> anyhow::Result<()> {
    let folder = PathBuf::from(env::var("CARGO_MANIFEST_DIR")?).join("../../interfaces").canonicalize()?;
    let mut packages = fs::read_dir(&folder)?.map(|each| Ok(each?.path())).collect::<std::io::Result<Vec<_>>>()?;
    packages.sort();
    // SAFETY: a build script has one thread.
    unsafe { env::set_var("HIROZ_MSG_PATH", env::join_paths(&packages)?) };
    println!("cargo:rerun-if-changed={}", folder.display());
    hiroz_codegen::generate_user_messages(&PathBuf::from(env::var("OUT_DIR")?), false)
}
