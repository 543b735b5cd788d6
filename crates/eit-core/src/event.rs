//! Events for a subscriber of `tracing`.

/// Reports an event: its level, a sentence, and fields, which are numbers, flags or `&str`. Without the
/// feature `tracing` of this crate no code remains.
#[macro_export]
#[cfg(feature = "tracing")]
macro_rules! event {
    ($level:ident, $message:literal $(, $field:ident = $value:expr)* $(,)?) => {
        $crate::tracing::event!($crate::tracing::Level::$level, $($field = $value,)* $message)
    };
}

/// Reports an event: its level, a sentence, and fields, which are numbers, flags or `&str`. Without the
/// feature `tracing` of this crate no code remains.
#[macro_export]
#[cfg(not(feature = "tracing"))]
macro_rules! event {
    ($level:ident, $message:literal $(, $field:ident = $value:expr)* $(,)?) => {
        // the fields are type-checked but never computed
        if false {
            $(let _ = &$value;)*
        }
    };
}
