//! The protocol's checksum: CRC-16 of polynomial x^16 + x^15 + x^2 + 1 (0x8005), most significant bit first, from 0
//! (ROBOTIS e-Manual, "CRC Calculation").

const POLYNOMIAL: u16 = 0x8005;

/// What a byte leaves behind, by the byte.
const TABLE: [u16; 256] = table();

const fn table() -> [u16; 256] {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut remainder = (byte as u16) << 8;
        let mut bit = 0;
        while bit < 8 {
            let carry = remainder & 0x8000 != 0;
            remainder <<= 1;
            if carry {
                remainder ^= POLYNOMIAL;
            }
            bit += 1;
        }
        table[byte] = remainder;
        byte += 1;
    }
    table
}

/// The checksum of what `crc` is the checksum of, and then `bytes`. It begins at 0.
pub fn crc16(crc: u16, bytes: &[u8]) -> u16 {
    bytes.iter().fold(crc, |crc, &byte| {
        (crc << 8) ^ TABLE[usize::from((crc >> 8) as u8 ^ byte)]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_check_value_of_this_crc_is_right() {
        // CRC-16/UMTS in Greg Cook's catalogue of parametrised CRC algorithms.
        assert_eq!(crc16(0, b"123456789"), 0xFEE8);
    }

    #[test]
    fn a_checksum_goes_on_where_it_stopped() {
        assert_eq!(crc16(crc16(0, b"1234"), b"56789"), 0xFEE8);
    }
}
