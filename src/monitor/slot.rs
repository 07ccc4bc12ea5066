//! A place that may be empty.

/// An `Option` that is all zeros where it is empty: a static that holds one lies in memory that the start-up code
/// clears, and takes no flash. (The compiler marks an empty `Option` in an unused bit pattern of its content.)
#[derive(Clone, Copy, Debug)]
#[repr(u8)]
pub(super) enum Slot<T> {
    Empty = 0,
    Full(T) = 1,
}

impl<T> Slot<T> {
    pub(super) const fn get(&self) -> Option<&T> {
        match self {
            Self::Empty => None,
            Self::Full(content) => Some(content),
        }
    }

    pub(super) const fn get_mut(&mut self) -> Option<&mut T> {
        match self {
            Self::Empty => None,
            Self::Full(content) => Some(content),
        }
    }

    pub(super) fn take(&mut self) -> Option<T> {
        core::mem::replace(self, Self::Empty).into()
    }
}

impl<T> From<Slot<T>> for Option<T> {
    fn from(slot: Slot<T>) -> Self {
        match slot {
            Slot::Empty => None,
            Slot::Full(content) => Some(content),
        }
    }
}

impl<T> From<Option<T>> for Slot<T> {
    fn from(option: Option<T>) -> Self {
        option.map_or(Self::Empty, Self::Full)
    }
}
