//! A vendor's shared library, found and loaded at run time.

// Functions of a library are what its vendor says they are; no compiler can check it.
#![allow(unsafe_code)]

use std::ffi::{CStr, c_char};
use std::path::{Path, PathBuf};

use crate::error::DriverError;

/// Whose library it is, and where to look for it.
pub(crate) struct Origin {
    pub(crate) vendor: &'static str,
    /// Names that the system's loader looks for, newest first.
    pub(crate) names: &'static [&'static str],
    /// Where a user names another file.
    pub(crate) remedy: &'static str,
}

/// A loaded library.
pub(crate) struct VendorLibrary {
    library: libloading::Library,
    path: PathBuf,
    vendor: &'static str,
}

impl VendorLibrary {
    /// Loads the named file, or the first of the vendor's names that the system finds. A name without a folder is a file
    /// of the working folder where there is one, and else one that the system looks for.
    pub(crate) fn open(origin: &Origin, named: Option<&Path>) -> Result<Self, DriverError> {
        let mut tried = Vec::new();
        let candidates: Vec<&Path> = match named {
            Some(path) => vec![path],
            None => origin.names.iter().map(Path::new).collect(),
        };
        for path in candidates {
            let here = Path::new(".").join(path);
            let file = if named.is_some() && here.exists() { here.as_path() } else { path };
            // SAFETY: loading runs the library's initialisers. The user has named the file or installed the vendor's
            // SDK in order to run it in this program.
            match unsafe { libloading::Library::new(file.as_os_str()) } {
                Ok(library) => return Ok(Self { library, path: file.into(), vendor: origin.vendor }),
                Err(error) => tried.push((file.to_path_buf(), full_text(&error))),
            }
        }
        Err(DriverError::Library { vendor: origin.vendor, tried: told(&tried), remedy: origin.remedy })
    }

    /// A function of the library.
    ///
    /// # Safety
    /// `T` is the type of a function pointer with the signature that the vendor documents for `symbol`. The library is
    /// kept as long as the pointer is called.
    pub(crate) unsafe fn function<T: Copy>(&self, symbol: &'static str) -> Result<T, DriverError> {
        // SAFETY: as the caller promises.
        let found = unsafe { self.library.get::<T>(symbol) };
        found.map(|function| *function).map_err(|error| DriverError::Symbol {
            path: self.path.clone(),
            vendor: self.vendor,
            symbol,
            reason: full_text(&error),
        })
    }
}

/// Where the system's loader looks for a file without a folder.
const SEARCHED: &str = if cfg!(windows) {
    "the program's folder, the system's and those of PATH"
} else if cfg!(target_os = "macos") {
    "DYLD_LIBRARY_PATH, /usr/local/lib and /usr/lib"
} else {
    "LD_LIBRARY_PATH and the folders of ldconfig"
};

/// What was tried, in one sentence: files with what the system said of them.
fn told(tried: &[(PathBuf, String)]) -> String {
    let (mut absent, mut parts) = (Vec::new(), Vec::new());
    for (file, said) in tried {
        let name = file.display().to_string();
        let bare = file.parent().is_none_or(|folder| folder.as_os_str().is_empty());
        // The loader's words for a file that is not there, and not for one that this file needs.
        if bare && said.contains(&format!("{name}: cannot open shared object file: No such file")) {
            absent.push(name);
        } else if !bare && !file.exists() {
            parts.push(format!("there is no file {name}"));
        } else {
            let said = said.strip_prefix("dlopen failed: ").unwrap_or(said);
            let reason = said.strip_prefix(&format!("{name}: ")).unwrap_or(said);
            parts.push(format!("{name}: {reason}"));
        }
    }
    if !absent.is_empty() {
        parts.push(format!("no {} in {SEARCHED}", absent.join(", ")));
    }
    parts.join("; ")
}

/// A text of the library; `None` for NULL.
///
/// # Safety
/// `text` is NULL or closed by a zero.
pub(crate) unsafe fn text_of(text: *const c_char) -> Option<String> {
    // SAFETY: as the caller promises.
    (!text.is_null()).then(|| unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned())
}

/// Declares the functions of a vendor's header that a driver calls, each once, as `Functions`.
macro_rules! vendor_functions {
    ($(#[$of:meta])* $($field:ident = $symbol:literal: fn($($argument:ty),*) $(-> $answer:ty)?;)*) => {
        $(#[$of])*
        #[derive(Clone, Copy)]
        pub(super) struct Functions {
            $(pub(super) $field: unsafe extern "C" fn($($argument),*) $(-> $answer)?,)*
        }

        impl Functions {
            pub(super) fn of(library: &VendorLibrary) -> Result<Self, DriverError> {
                // SAFETY: the signatures are those of the vendor's header; the library is kept beside the functions.
                Ok(unsafe { Self { $($field: library.function($symbol)?,)* } })
            }
        }
    };
}
pub(crate) use vendor_functions;

/// An error with its causes.
fn full_text(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(next) = cause {
        text = format!("{text}: {next}");
        cause = next.source();
    }
    text
}

#[cfg(test)]
mod tests {
    use super::told;

    #[test]
    fn names_that_are_nowhere_are_one_part_and_a_file_that_is_there_keeps_its_reason() {
        let absent = |name: &str| {
            let said = format!("dlopen failed: {name}: cannot open shared object file: No such file or directory");
            (name.into(), said)
        };
        let text = told(&[absent("libone.so.3"), absent("libone.so")]);
        assert!(text.starts_with("no libone.so.3, libone.so in ") && !text.contains("cannot open"), "{text}");
        let needs = "dlopen failed: libusb.so: cannot open shared object file: No such file or directory";
        let text = told(&[("libone.so".into(), needs.into()), absent("libtwo.so")]);
        assert!(text.starts_with("libone.so: libusb.so: cannot open") && text.contains("; no libtwo.so in "), "{text}");
        let text = told(&[("/no/such/libone.so".into(), String::new())]);
        assert_eq!(text, "there is no file /no/such/libone.so");
        let here = env!("CARGO_MANIFEST_PATH");
        let text = told(&[(here.into(), format!("dlopen failed: {here}: invalid ELF header"))]);
        assert_eq!(text, format!("{here}: invalid ELF header"));
    }
}
