//! Letters in pictures.

use std::sync::LazyLock;

use super::raster::Image;

/// ASCII 32 to 126 side by side, black on white inverted (1 is ink), one bit a pixel: `10x20` of the fonts `misc-fixed`
/// of the X Window System, which are in the public domain.
const FONT: &[u8] = include_bytes!("font.png");
const FIRST: u8 = b' ';
const LAST: u8 = b'~';
/// Size of a letter (pixels).
pub(crate) const LETTER: [usize; 2] = [10, 20];

/// Rows of the font, eight pixels a byte.
static ROWS: LazyLock<(usize, Vec<u8>)> = LazyLock::new(|| {
    let reader = png::Decoder::new(std::io::Cursor::new(FONT)).read_info();
    let mut reader = reader.expect("the font is a PNG file");
    let mut bytes = vec![0; reader.output_buffer_size().expect("the font is small")];
    let info = reader.next_frame(&mut bytes).expect("the font is whole");
    (info.line_size, bytes)
});

/// Width of a text (pixels).
pub(crate) fn text_width(text: &str) -> usize {
    LETTER[0] * text.chars().count()
}

/// Writes a line with its upper left corner at a pixel. What falls outside is dropped; a letter that the font has not is
/// a question mark.
pub(crate) fn write(image: &mut Image, [x, y]: [usize; 2], text: &str, color: [u8; 3]) {
    let (stride, rows) = &*ROWS;
    for (place, letter) in text.chars().enumerate() {
        let code = u8::try_from(letter)
            .ok()
            .filter(|code| (FIRST..=LAST).contains(code));
        let glyph = LETTER[0] * usize::from(code.unwrap_or(b'?') - FIRST);
        for row in 0..LETTER[1] {
            for column in 0..LETTER[0] {
                let bit = glyph + column;
                let ink = rows[row * stride + bit / 8] >> (7 - bit % 8) & 1 == 1;
                let [right, down] = [x + LETTER[0] * place + column, y + row];
                if ink && right < image.width && down < image.height {
                    let start = 3 * (down * image.width + right);
                    image.rgb[start..start + 3].copy_from_slice(&color);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_are_drawn_where_they_are_told_and_no_further() {
        let mut image = Image::white(45, 30);
        write(&mut image, [5, 4], "H I~\u{e9}", [0; 3]);
        let ink = |x: usize, y: usize| image.rgb[3 * (y * image.width + x)] == 0;
        let inked = |columns: std::ops::Range<usize>| {
            let all = (0..30).flat_map(|y| columns.clone().map(move |x| (x, y)));
            all.filter(|&(x, y)| ink(x, y)).count()
        };
        // The stems of an H, a blank, and the letter that does not fit.
        assert!(inked(5..15) > 20 && inked(25..35) > 10 && inked(35..45) > 3);
        assert_eq!(inked(0..5) + inked(15..25), 0);
        // Both stems of the H in each of its rows.
        let rows = (4..24).filter(|&y| (5..15).filter(|&x| ink(x, y)).count() >= 2);
        assert!(rows.count() >= 10);
    }
}
