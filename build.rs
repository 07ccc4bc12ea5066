//! Gives the linker what the repository's own images need: memory layout, vector table, log strings.
//!
//! The arguments are bound to the images, the search path of the memory layout too, and they do not depend on `RUSTFLAGS`:
//! neither a host build nor a firmware that uses the library sees any of it.

use std::{env, error::Error, fs, path::PathBuf};

/// Start of the flash of an STM32H743, bank 1.
const FLASH_ORIGIN_STM32H743: u32 = 0x0800_0000;
/// Start of the code memory (SSRAM1) of the emulated mps2 boards.
const FLASH_ORIGIN_MPS2: u32 = 0x0000_0000;

/// The binaries that go to a microcontroller, which the feature `firmware` is for.
const FIRMWARE: [&str; 2] = ["firmware", "firmware-monitor"];

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=memory.x");
    if env::var_os("CARGO_FEATURE_FIRMWARE").is_none() || env::var("CARGO_CFG_TARGET_OS")? != "none" {
        return Ok(());
    }
    let flash_origin = if env::var_os("CARGO_FEATURE_BOARD_STM32H743").is_some() {
        FLASH_ORIGIN_STM32H743
    } else {
        FLASH_ORIGIN_MPS2
    };
    // cortex-m-rt's link.x includes a file of this name from the linker's search path.
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::copy("memory.x", out.join("memory.x"))?;
    for argument in [
        // Not as `rustc-link-search`, which would reach whoever depends on the library.
        format!("-L{}", out.display()),
        format!("--defsym=_flash_origin={flash_origin:#x}"),
        // Sections that are not page aligned keep the image as small as the flash needs it.
        "--nmagic".to_owned(),
        "-Tlink.x".to_owned(),
        "-Tdefmt.x".to_owned(),
    ] {
        for binary in FIRMWARE {
            println!("cargo:rustc-link-arg-bin={binary}={argument}");
        }
    }
    Ok(())
}
