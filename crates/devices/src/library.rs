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
                Err(error) => tried.push(format!("{}: {}", path.display(), full_text(&error))),
            }
        }
        Err(DriverError::Library { vendor: origin.vendor, tried: tried.join("; "), remedy: origin.remedy })
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
