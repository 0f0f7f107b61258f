//! The lowest layer: reading byte arrays from the front of a slice, and writing them into a buffer.
//!
//! Scalars are built on it. It knows nothing about messages, so a [`Fault`] has no place; the message's codec adds it
//! (see [`DecodeError`](crate::DecodeError) and [`EncodeError`](crate::EncodeError)).

/// The faults that a scalar alone can find.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The bytes, or the space for them, end before the field does.
    Short,
    /// No source gives the field's length.
    UnknownLength,
}

/// Bytes not read yet.
#[derive(Clone, Debug)]
pub struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    /// A reader at the start of `bytes`.
    #[inline]
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    /// Reads the next `N` bytes.
    ///
    /// # Errors
    /// [`Fault::Short`] if fewer are left; then none is read.
    #[inline]
    pub fn chunk<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let (chunk, rest) = self.rest.split_first_chunk().ok_or(Fault::Short)?;
        self.rest = rest;
        Ok(*chunk)
    }

    /// Reads the next `count` bytes, where the count is not known at compile time.
    ///
    /// # Errors
    /// [`Fault::Short`] if fewer are left; then none is read.
    #[inline]
    pub fn take(&mut self, count: usize) -> Result<&'a [u8], Fault> {
        let (taken, rest) = self.rest.split_at_checked(count).ok_or(Fault::Short)?;
        self.rest = rest;
        Ok(taken)
    }

    /// How many bytes are left.
    #[inline]
    pub fn remaining(&self) -> usize {
        self.rest.len()
    }
}

/// A buffer being filled.
#[derive(Debug)]
pub struct Writer<'a> {
    out: &'a mut [u8],
    at: usize,
}

impl<'a> Writer<'a> {
    /// A writer at the start of `out`.
    #[inline]
    pub fn new(out: &'a mut [u8]) -> Self {
        Self { out, at: 0 }
    }

    /// Appends `N` bytes.
    ///
    /// # Errors
    /// [`Fault::Short`] if the buffer has less space; then nothing is written.
    #[inline]
    pub fn put<const N: usize>(&mut self, bytes: [u8; N]) -> Result<(), Fault> {
        let end = self.at + N;
        self.out
            .get_mut(self.at..end)
            .ok_or(Fault::Short)?
            .copy_from_slice(&bytes);
        self.at = end;
        Ok(())
    }

    /// How many bytes are written.
    #[inline]
    pub fn position(&self) -> usize {
        self.at
    }

    /// The whole buffer, to fill in a part that was left empty, such as the presence vector.
    #[inline]
    pub fn buffer(&mut self) -> &mut [u8] {
        self.out
    }
}
