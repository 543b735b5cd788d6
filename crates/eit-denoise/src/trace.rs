//! Events for a subscriber of `tracing` (feature `tracing`). Without the feature no code remains.

/// Reports an event: its level, its fields, which are numbers, flags or `&str`, and a sentence.
macro_rules! event {
    ($level:ident, $message:literal $(, $field:ident = $value:expr)* $(,)?) => {{
        #[cfg(feature = "tracing")]
        tracing::event!(tracing::Level::$level, $($field = $value,)* $message);
        // the fields are seen by the compiler, but never computed
        #[cfg(not(feature = "tracing"))]
        if false {
            $(let _ = &$value;)*
        }
    }};
}
