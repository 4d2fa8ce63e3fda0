//! Messages of ROS 2 as bytes: Common Data Representation (OMG DDS-XTypes 1.3, 7.4.1), version 1, little-endian.
//!
//! A number is aligned to its size, counted from behind the four bytes that say how the message is encoded.

/// Plain CDR, little-endian, and two bytes of options.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// A message that grows field by field.
pub(super) struct Cdr {
    bytes: Vec<u8>,
}

impl Cdr {
    pub fn new() -> Self {
        Self {
            bytes: ENCAPSULATION.to_vec(),
        }
    }

    pub fn finish(self) -> Vec<u8> {
        self.bytes
    }

    fn align(&mut self, size: usize) {
        let content = self.bytes.len() - ENCAPSULATION.len();
        let length = ENCAPSULATION.len() + content.next_multiple_of(size);
        self.bytes.resize(length, 0);
    }

    pub fn u8(&mut self, value: u8) -> &mut Self {
        self.bytes.push(value);
        self
    }

    pub fn bool(&mut self, value: bool) -> &mut Self {
        self.u8(value.into())
    }

    pub fn u32(&mut self, value: u32) -> &mut Self {
        self.align(4);
        self.bytes.extend(value.to_le_bytes());
        self
    }

    pub fn i32(&mut self, value: i32) -> &mut Self {
        self.align(4);
        self.bytes.extend(value.to_le_bytes());
        self
    }

    pub fn f64(&mut self, value: f64) -> &mut Self {
        self.align(8);
        self.bytes.extend(value.to_le_bytes());
        self
    }

    /// The number of a sequence's elements, which stands before them. Messages have less than 4 GB.
    pub fn count(&mut self, count: usize) -> &mut Self {
        self.u32(u32::try_from(count).unwrap_or(u32::MAX))
    }

    /// Text, which ends with a zero.
    pub fn text(&mut self, text: &str) -> &mut Self {
        self.count(text.len() + 1);
        self.bytes.extend(text.bytes());
        self.u8(0)
    }

    /// A sequence of bytes.
    pub fn octets(&mut self, bytes: &[u8]) -> &mut Self {
        self.count(bytes.len());
        self.bytes.extend(bytes);
        self
    }

    /// An array of fixed length.
    pub fn array(&mut self, values: &[f64]) -> &mut Self {
        for value in values {
            self.f64(*value);
        }
        self
    }

    /// A sequence of numbers.
    pub fn numbers(&mut self, values: &[f64]) -> &mut Self {
        self.count(values.len()).array(values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_aligned_behind_the_encapsulation() {
        let mut cdr = Cdr::new();
        cdr.u8(7).u32(1).text("ab").f64(0.5).octets(&[9]);
        let expected = [
            &[0, 1, 0, 0][..],
            &[7, 0, 0, 0, 1, 0, 0, 0],
            &[3, 0, 0, 0, b'a', b'b', 0],
            // The text ends at 15, and the number begins at 16.
            &[0],
            &0.5_f64.to_le_bytes(),
            &[1, 0, 0, 0, 9],
        ];
        assert_eq!(cdr.finish(), expected.concat());
    }
}
