//! JPEG images like those of a webcam, with exactly known grey levels.
//!
//! Each block of 8 x 8 px has one grey level, so that its only coefficient gives that level without rounding. Chroma
//! has half the width, and the Huffman tables are omitted, as in most webcams. Written from ITU-T T.81: Annex B for the
//! segments, K.3 for the codes.

/// The code of each difference size: bits and their number.
type Codes = [(u32, u32); 12];

const LUMA: Codes = [
    (0b00, 2),
    (0b010, 3),
    (0b011, 3),
    (0b100, 3),
    (0b101, 3),
    (0b110, 3),
    (0b1110, 4),
    (0b1_1110, 5),
    (0b11_1110, 6),
    (0b111_1110, 7),
    (0b1111_1110, 8),
    (0b1_1111_1110, 9),
];
const CHROMA: Codes = [
    (0b00, 2),
    (0b01, 2),
    (0b10, 2),
    (0b110, 3),
    (0b1110, 4),
    (0b1_1110, 5),
    (0b11_1110, 6),
    (0b111_1110, 7),
    (0b1111_1110, 8),
    (0b1_1111_1110, 9),
    (0b11_1111_1110, 10),
    (0b111_1111_1110, 11),
];
/// The code that ends a block.
const LUMA_END: (u32, u32) = (0b1010, 4);
const CHROMA_END: (u32, u32) = (0b00, 2);

/// Writes bits, highest first, and a zero byte after each 0xff.
struct Bits {
    bytes: Vec<u8>,
    waiting: u64,
    count: u32,
}

impl Bits {
    /// Appends the lowest `count` of `bits`, most significant first.
    fn put(&mut self, (bits, count): (u32, u32)) {
        self.waiting = self.waiting << count | u64::from(bits);
        self.count += count;
        while self.count >= 8 {
            self.count -= 8;
            let byte = (self.waiting >> self.count) as u8;
            self.bytes.push(byte);
            if byte == 0xff {
                self.bytes.push(0);
            }
        }
    }

    /// Writes a block of one level, as its difference from `last`, the coefficient of the previous block of its colour.
    fn put_block(&mut self, codes: &Codes, end: (u32, u32), level: u8, last: &mut i32) {
        let coefficient = 8 * (i32::from(level) - 128);
        let difference = coefficient - *last;
        *last = coefficient;
        let size = 32 - difference.unsigned_abs().leading_zeros();
        self.put(codes[size as usize]);
        let bits = if difference < 0 { difference - 1 } else { difference };
        self.put((bits.cast_unsigned() & ((1 << size) - 1), size));
        self.put(end);
    }
}

/// Encodes a colour image whose 8 x 8 px blocks have the grey level `level(column, row)`.
///
/// The width must be a multiple of 16, the height of 8.
pub fn encode_picture((width, height): (u16, u16), level: impl Fn(usize, usize) -> u8) -> Vec<u8> {
    let mut file = vec![0xff, 0xd8, 0xff, 0xdb, 0, 67, 0];
    file.extend([1; 64]);
    file.extend([0xff, 0xc0, 0, 17, 8]);
    file.extend(height.to_be_bytes());
    file.extend(width.to_be_bytes());
    file.extend([3, 1, 0x21, 0, 2, 0x11, 0, 3, 0x11, 0]);
    file.extend([0xff, 0xda, 0, 12, 3, 1, 0x00, 2, 0x11, 3, 0x11, 0, 63, 0]);
    let mut bits = Bits { bytes: Vec::new(), waiting: 0, count: 0 };
    let mut last = [0; 3];
    for row in 0..usize::from(height) / 8 {
        for pair in 0..usize::from(width) / 16 {
            for column in [2 * pair, 2 * pair + 1] {
                bits.put_block(&LUMA, LUMA_END, level(column, row), &mut last[0]);
            }
            // Colours differ between blocks, which exposes a decoder that takes them for grey.
            bits.put_block(&CHROMA, CHROMA_END, (40 + 50 * (pair % 4)) as u8, &mut last[1]);
            bits.put_block(&CHROMA, CHROMA_END, (210 - 60 * (row % 3)) as u8, &mut last[2]);
        }
    }
    bits.put((0x7f, 7));
    file.extend(bits.bytes);
    file.extend([0xff, 0xd9]);
    file
}
