//! Structs of the border, which begin with their size.
//!
//! A struct grows at its end only. What the caller does not know stays at its default when it is read, and is not
//! written; what the library does not know is not touched.

use std::mem::size_of;
use std::ptr;

use crate::status::Status;

/// A struct of the border.
///
/// # Safety
/// `repr(C)`, without padding that matters and without invariants: any bytes are a value. The first field is
/// `struct_size: u32`, and [`Sized::LEAST`] reaches to the end of a field.
pub(crate) unsafe trait Layout: Copy {
    /// Bytes that every version holds.
    const LEAST: usize;

    /// The value of fields that the caller does not know.
    fn absent() -> Self;
}

/// Reads a struct of the caller.
///
/// # Safety
/// `from` is NULL, or points to `*from as u32` readable bytes that nobody writes meanwhile, aligned as a `T`.
pub(crate) unsafe fn read<T: Layout>(from: *const T) -> Result<T, Status> {
    if from.is_null() {
        return Err(Status::ErrorNull);
    }
    // SAFETY: a struct of the border begins with its size, which the caller answers for.
    let size = unsafe { from.cast::<u32>().read() } as usize;
    if size < T::LEAST {
        return Err(Status::ErrorStructSize);
    }
    let mut value = T::absent();
    // SAFETY: `size` bytes can be read, `size_of::<T>()` written; any bytes are a T; a local is nobody else's.
    unsafe { ptr::copy_nonoverlapping(from.cast::<u8>(), (&raw mut value).cast::<u8>(), size.min(size_of::<T>())) };
    Ok(value)
}

/// Whether a struct of the caller has room for what every version holds.
///
/// # Safety
/// `to` is NULL, or points to a readable size.
pub(crate) unsafe fn room<T: Layout>(to: *const T) -> Result<(), Status> {
    if to.is_null() {
        return Err(Status::ErrorNull);
    }
    // SAFETY: as the caller promises.
    let size = unsafe { to.cast::<u32>().read() } as usize;
    if size < T::LEAST { Err(Status::ErrorStructSize) } else { Ok(()) }
}

/// Writes what the caller's struct has room for, but for its size.
///
/// # Safety
/// `to` is NULL, or points to `*to as u32` bytes that can be read and written and are nobody else's, aligned as a `T`.
pub(crate) unsafe fn write<T: Layout>(to: *mut T, value: &T) -> Result<(), Status> {
    const SIZE: usize = size_of::<u32>();
    if to.is_null() {
        return Err(Status::ErrorNull);
    }
    // SAFETY: a struct of the border begins with its size, which the caller answers for.
    let size = unsafe { to.cast::<u32>().read() } as usize;
    let known = size.min(size_of::<T>());
    if known > SIZE {
        let from = ptr::from_ref(value).cast::<u8>();
        // SAFETY: both have `known` bytes, the first four of which are left out; a local cannot overlap the caller's.
        unsafe { ptr::copy_nonoverlapping(from.add(SIZE), to.cast::<u8>().add(SIZE), known - SIZE) };
    }
    if size < T::LEAST { Err(Status::ErrorStructSize) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[repr(C)]
    #[derive(Clone, Copy, Debug, PartialEq)]
    struct Pair {
        struct_size: u32,
        first: u32,
        second: f64,
    }

    // SAFETY: repr(C), two plain numbers after the size; LEAST ends after `first`.
    unsafe impl Layout for Pair {
        const LEAST: usize = 8;
        fn absent() -> Self {
            Self { struct_size: 0, first: 0, second: -1.0 }
        }
    }

    #[test]
    fn an_older_struct_is_read_as_far_as_it_goes() {
        let given = Pair { struct_size: 8, first: 5, second: 7.0 };
        // SAFETY: a whole Pair can be read.
        assert_eq!(unsafe { read(&raw const given) }, Ok(Pair { second: -1.0, ..given }));
        let whole = Pair { struct_size: 400, ..given };
        let mut room = [0_u64; 50];
        // SAFETY: 400 bytes, aligned to eight, as the struct says.
        let newer = unsafe {
            room.as_mut_ptr().cast::<Pair>().write(whole);
            read(room.as_ptr().cast::<Pair>())
        };
        assert_eq!(newer, Ok(whole));
    }

    #[test]
    fn an_older_struct_is_written_as_far_as_it_goes() {
        let value = Pair { struct_size: 1, first: 2, second: 3.0 };
        for (size, expected) in [(16, (2, 3.0)), (8, (2, 9.0)), (6, (2, 9.0)), (4, (9, 9.0)), (0, (9, 9.0))] {
            let mut room = Pair { struct_size: size, first: 9, second: 9.0 };
            // SAFETY: a whole Pair can be written.
            let outcome = unsafe { write(&raw mut room, &value) };
            assert_eq!(room, Pair { struct_size: size, first: expected.0, second: expected.1 }, "{size} bytes");
            assert_eq!(outcome.is_ok(), size >= 8, "{size} bytes");
        }
    }

    #[test]
    fn no_pointer_and_no_room_are_refused() {
        // SAFETY: NULL is allowed.
        assert_eq!(unsafe { read::<Pair>(ptr::null()) }, Err(Status::ErrorNull));
        // SAFETY: NULL is allowed.
        assert_eq!(unsafe { write::<Pair>(ptr::null_mut(), &Pair::absent()) }, Err(Status::ErrorNull));
        let given = Pair { struct_size: 4, first: 5, second: 7.0 };
        // SAFETY: a whole Pair can be read.
        assert_eq!(unsafe { read(&raw const given) }, Err(Status::ErrorStructSize));
    }
}
