//! Isolates third-party readers: a panic in one of them becomes an ordinary error and prints nothing.

use std::{
    any::Any,
    cell::Cell,
    panic::{self, AssertUnwindSafe},
    sync::Once,
};

thread_local! {
    /// Whether this thread is inside [`caught`], whose caller reports a panic.
    static IS_CAUGHT: Cell<bool> = const { Cell::new(false) };
}

/// Sets the thread's flag and restores it at the end of the scope.
struct Mark(bool);

impl Mark {
    fn set() -> Self {
        Self(IS_CAUGHT.replace(true))
    }
}

impl Drop for Mark {
    fn drop(&mut self) {
        IS_CAUGHT.set(self.0);
    }
}

/// Returns the result of `read`, or the message of its panic. `read` must run on this thread and leave no partial state that is used after
/// a panic.
///
/// # Errors
/// The panic's message. The caller adds the file name.
pub(crate) fn caught<T>(read: impl FnOnce() -> T) -> Result<T, String> {
    static QUIET: Once = Once::new();
    QUIET.call_once(|| {
        let before = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !IS_CAUGHT.get() {
                before(info);
            }
        }));
    });
    let mark = Mark::set();
    let result = panic::catch_unwind(AssertUnwindSafe(read));
    drop(mark);
    result.map_err(|payload| format!("the file is damaged ({})", message(&*payload)))
}

fn message(payload: &(dyn Any + Send)) -> &str {
    let text = payload.downcast_ref::<&str>().copied();
    text.or_else(|| payload.downcast_ref::<String>().map(String::as_str)).unwrap_or("the reader stopped")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_a_message() {
        assert_eq!(caught(|| 7), Ok(7));
        let empty: [u8; 0] = [];
        assert!(caught(|| empty[std::hint::black_box(3)]).unwrap_err().contains("index out of bounds"));
        // The flag is restored: another panic prints as usual.
        assert!(!IS_CAUGHT.get());
        let nested = caught(|| (caught(|| panic!("inner")), IS_CAUGHT.get()));
        assert_eq!(nested, Ok((Err::<(), _>("the file is damaged (inner)".to_owned()), true)));
    }
}
