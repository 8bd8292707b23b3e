//! Enumerations whose members have public names or numbers, and sets of their members.

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

/// Declares a set of the members of such an enumeration.
macro_rules! set {
    ($(#[$doc:meta])* $set:ident of $kind:ident) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
        pub struct $set(u32);

        impl $set {
            /// Whether a member is in the set.
            #[inline(always)]
            pub fn contains(self, member: $kind) -> bool {
                self.0 & (1 << member as u32) != 0
            }
        }

        impl FromIterator<$kind> for $set {
            fn from_iter<I: IntoIterator<Item = $kind>>(members: I) -> Self {
                Self(members.into_iter().fold(0, |set, member| set | 1 << member as u32))
            }
        }
    };
}
pub(crate) use set;

/// Declares the kinds of a part. The flat array of parameters has the number of the kind.
macro_rules! numbered {
    ($(#[$doc:meta])* $name:ident { $(#[$first_doc:meta])* $first:ident, $($(#[$kind_doc:meta])* $kind:ident,)* }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
        pub enum $name {
            $(#[$first_doc])*
            #[default]
            $first,
            $($(#[$kind_doc])* $kind,)*
        }

        impl $name {
            const ALL: &[Self] = &[Self::$first, $(Self::$kind),*];

            pub fn has(number: f64) -> bool {
                Self::ALL.iter().any(|kind| kind.number() == number)
            }

            pub fn of(number: f64) -> Self {
                Self::ALL.iter().copied().find(|kind| kind.number() == number).unwrap_or_default()
            }

            pub fn number(self) -> f64 {
                f64::from(self as u8)
            }
        }
    };
}
pub(crate) use numbered;
