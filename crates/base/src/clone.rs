//! Copies of states into the memory there is: each step keeps some.

/// Implements [`Clone`] by all fields, `clone_in_place!([generics] Type { field, field })`. Its `clone_from` copies each
/// into the memory that is there, which derived code does not.
#[macro_export]
macro_rules! clone_in_place {
    ([$($generics:tt)*] $type:ty { $($field:ident),* $(,)? }) => {
        impl<$($generics)*> Clone for $type {
            fn clone(&self) -> Self {
                Self { $($field: self.$field.clone()),* }
            }

            fn clone_from(&mut self, source: &Self) {
                $(self.$field.clone_from(&source.$field);)*
            }
        }
    };
    ($type:ty { $($fields:tt)* }) => {
        $crate::clone_in_place!([] $type { $($fields)* });
    };
}
