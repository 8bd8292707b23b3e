//! Enumerations whose members have public names.

/// Declares an enumeration with a table of its members by their public names.
macro_rules! named {
    (
        $(#[$doc:meta])* $kind:ident;
        $(#[$table_doc:meta])* $table:ident = { $($(#[$member_doc:meta])* $member:ident = $name:literal,)* }
    ) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum $kind {
            $($(#[$member_doc])* $member,)*
        }

        #[doc = concat!("The members of [`", stringify!($kind), "`] by their public names.")]
        $(#[$table_doc])*
        pub const $table: [(&str, $kind); [$($name),*].len()] = [$(($name, $kind::$member)),*];

        impl $kind {
            /// The public name.
            pub fn name(self) -> &'static str {
                $table[self as usize].0
            }
        }
    };
}
pub(crate) use named;
