//! What an image takes of the part's memory, and what has slipped into it.

use super::error::EmulatorError;
use object::{Object, ObjectSection, ObjectSymbol, SectionFlags, SectionKind, elf};

/// What an image takes of the part's memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Footprint {
    /// Address of the vector table, where the flash of the board starts.
    pub flash_origin: u64,
    /// Code, constants and the initial values of variables, bytes.
    pub flash_bytes: u64,
    /// Flash, bytes, without what is there for the board and the serial line: the core and its maths, and all that
    /// cannot be told by its name.
    pub core_flash_bytes: u64,
    /// Variables, bytes. The stack, measured by the run itself, comes on top.
    pub static_ram_bytes: u64,
    /// Routines of double-precision arithmetic in software: a step in `f64` has slipped in where there is one.
    ///
    /// They tell nothing of an image built for [`Cpu::CortexM7`](super::Cpu::CortexM7), which has the arithmetic in
    /// hardware: ask it of the Cortex-M4F image of the same source.
    pub soft_double_symbols: Vec<String>,
}

/// Measures an image.
pub(super) fn of_image(image: &[u8]) -> Result<Footprint, EmulatorError> {
    let invalid = |error: object::Error| EmulatorError::Image(error.to_string());
    let file = object::File::parse(image).map_err(invalid)?;
    let vectors = file.section_by_name(".vector_table");
    let vectors = vectors.ok_or_else(|| EmulatorError::Image("no vector table".to_owned()))?;
    let mut footprint = Footprint {
        flash_origin: vectors.address(),
        flash_bytes: 0,
        core_flash_bytes: 0,
        static_ram_bytes: 0,
        soft_double_symbols: Vec::new(),
    };
    for section in file.sections() {
        let SectionFlags::Elf { sh_flags } = section.flags() else {
            return Err(EmulatorError::Image("not an ELF file".to_owned()));
        };
        if sh_flags & u64::from(elf::SHF_ALLOC) == 0 {
            continue;
        }
        let uninitialised = section.kind() == SectionKind::UninitializedData;
        if uninitialised || sh_flags & u64::from(elf::SHF_WRITE) != 0 {
            footprint.static_ram_bytes += section.size();
        }
        if !uninitialised {
            footprint.flash_bytes += section.size();
        }
    }
    let mut symbols = file.symbols().peekable();
    if symbols.peek().is_none() {
        return Err(EmulatorError::Stripped);
    }
    // No symbol of the vector table has a name that counts as around the core.
    let mut around_bytes = vectors.size();
    for symbol in symbols.filter(ObjectSymbol::is_definition) {
        let name = symbol.name().map_err(invalid)?;
        if is_soft_double(name) {
            footprint.soft_double_symbols.push(name.to_owned());
        }
        let section = symbol.section_index().and_then(|index| file.section_by_index(index).ok());
        let is_in_flash = section
            .is_some_and(|section| matches!(section.kind(), SectionKind::Text | SectionKind::ReadOnlyData));
        if is_in_flash && is_around_the_core(&rustc_demangle::demangle(name).to_string()) {
            around_bytes += symbol.size();
        }
    }
    footprint.core_flash_bytes = footprint.flash_bytes.saturating_sub(around_bytes);
    footprint.soft_double_symbols.sort_unstable();
    footprint.soft_double_symbols.dedup();
    Ok(footprint)
}

/// Does this demangled name belong to the board, the log or the serial line: to the monitor's own image, the library's
/// module for packets, or the crates that only these two use? A negative control stands for code of the core.
fn is_around_the_core(name: &str) -> bool {
    const AROUND: [&str; 10] = [
        "firmware_monitor::",
        "eha_monitor::link::",
        "postcard::",
        "cobs::",
        "crc::",
        "serde_core::",
        "defmt",
        "cortex_m",
        "critical_section",
        "semihosting",
    ];
    !name.contains("::hogs::") && AROUND.iter().any(|part| name.contains(part))
}

/// Does this name belong to a routine that computes on, or converts from or to, `f64`?
///
/// The names are those of the ARM run-time ABI (section 5.1.2) and of libgcc, whose mode `DF` is `f64`.
fn is_soft_double(name: &str) -> bool {
    const CONVERSIONS_TO_DOUBLE: [&str; 6] =
        ["__aeabi_f2d", "__aeabi_h2d", "__aeabi_i2d", "__aeabi_ui2d", "__aeabi_l2d", "__aeabi_ul2d"];
    let libgcc = name.strip_prefix("__").is_some_and(|rest| {
        rest.contains("df")
            && rest.ends_with(|last: char| last.is_ascii_digit() || last == 'f' || last == 'i')
    });
    // `__aeabi_cdcmple` and its like compare doubles for the flags.
    name.starts_with("__aeabi_d")
        || name.starts_with("__aeabi_cdcmp")
        || name.starts_with("__aeabi_cdrcmp")
        || CONVERSIONS_TO_DOUBLE.contains(&name)
        || libgcc
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn double_precision_routines_are_known_by_name() {
        for name in [
            "__aeabi_dadd",
            "__aeabi_dmul",
            "__aeabi_d2f",
            "__aeabi_f2d",
            "__aeabi_cdcmple",
            "__adddf3",
            "__muldf3",
            "__extendsfdf2",
            "__truncdfsf2",
            "__floatunsidf",
            "__fixdfsi",
            "__unorddf2",
        ] {
            assert!(is_soft_double(name), "{name}");
        }
        for name in [
            "__aeabi_uldivmod",
            "__aeabi_memcpy",
            "__aeabi_f2iz",
            "__addsf3",
            "__mulsf3",
            "__sidata",
            "__ebss",
        ] {
            assert!(!is_soft_double(name), "{name}");
        }
    }

    #[test]
    fn board_and_line_are_known_by_name() {
        for name in [
            "firmware_monitor::mcu::uart::Uart::send",
            "eha_monitor::link::station::reply",
            "<&mut postcard::ser::serializer::Serializer<F> as serde_core::ser::SerializeStruct>::serialize_field",
            "_defmt_write",
            "cortex_m_stack::stack_painted",
        ] {
            assert!(is_around_the_core(name), "{name}");
        }
        for name in [
            "eha_monitor::integrate::attempt",
            "eha_monitor::monitor::Monitor<S,_,_,_>::take",
            "libm::math::sqrt::sqrtf",
            "compiler_builtins::mem::memcpy",
            "firmware_monitor::mcu::hogs::flash::TABLE",
        ] {
            assert!(!is_around_the_core(name), "{name}");
        }
    }

    #[test]
    fn what_is_no_image_is_an_error() {
        assert!(matches!(of_image(b"not an ELF file"), Err(EmulatorError::Image(_))));
    }
}
