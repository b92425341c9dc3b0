//! Small files of cameras and microscopy programs, written as their formats are published.

use super::pages::Kind;

/// A CINE file: times of the images count from the trigger, s.
#[derive(Debug, Clone)]
pub struct Cine {
    pub first_image: i32,
    pub size: [i32; 2],
    pub stored_bits: u16,
    pub real_bits: u32,
    pub rate_hz: u32,
    /// `Compression` of the file, `biCompression` of the bitmaps.
    pub compression: [u32; 2],
    pub times_s: Option<Vec<f64>>,
    /// Length of the set-up, bytes.
    pub setup_bytes: usize,
    /// Further fields of the set-up: offset and value.
    pub setup: Vec<(usize, u32)>,
    /// Horizontal and vertical resolution, pixels per metre.
    pub per_metre: [i32; 2],
    pub images: Vec<Vec<u8>>,
}

impl Cine {
    /// Trigger of the files, s since the Unix epoch.
    pub const TRIGGER_S: u64 = 1_500_000_000;

    /// Grey images of 8 bits, stored bottom row first.
    pub fn new(size: [i32; 2], rate_hz: u32, images: Vec<Vec<u8>>) -> Self {
        Self {
            first_image: -10,
            size,
            stored_bits: 8,
            real_bits: 8,
            rate_hz,
            compression: [0, 0],
            times_s: None,
            setup_bytes: 10_408,
            setup: Vec::new(),
            per_metre: [0, 0],
            images,
        }
    }

    pub fn bytes(&self) -> Vec<u8> {
        let (bitmap_at, setup_at) = (44_u32, 84_u32);
        let blocks: Vec<u8> = self.times_s.as_deref().map_or_else(Vec::new, time_block);
        let table_at = setup_at + (self.setup_bytes + blocks.len()) as u32;
        let count = self.images.len() as u32;
        let mut file = b"CI".to_vec();
        file.extend(44_u16.to_le_bytes());
        file.extend((self.compression[0] as u16).to_le_bytes());
        file.extend(1_u16.to_le_bytes());
        for value in [self.first_image as u32, count, self.first_image as u32, count, bitmap_at, setup_at, table_at] {
            file.extend(value.to_le_bytes());
        }
        file.extend((Self::TRIGGER_S << 32).to_le_bytes());
        file.extend(40_u32.to_le_bytes());
        self.size.iter().for_each(|side| file.extend(side.to_le_bytes()));
        file.extend([1_u16.to_le_bytes(), self.stored_bits.to_le_bytes()].concat());
        file.extend([self.compression[1].to_le_bytes(), 0_u32.to_le_bytes()].concat());
        self.per_metre.iter().for_each(|value| file.extend(value.to_le_bytes()));
        file.extend([0; 8]);
        file.extend(self.setup_table());
        file.extend(blocks);
        let mut at = u64::from(table_at) + 8 * self.images.len() as u64;
        for image in &self.images {
            file.extend(at.to_le_bytes());
            at += 8 + image.len() as u64;
        }
        for image in &self.images {
            file.extend([8_u32.to_le_bytes(), (image.len() as u32).to_le_bytes()].concat());
            file.extend(image);
        }
        file
    }

    fn setup_table(&self) -> Vec<u8> {
        let mut setup = vec![0_u8; self.setup_bytes];
        setup[0..2].copy_from_slice(&(self.rate_hz.min(65_535) as u16).to_le_bytes());
        setup[140..142].copy_from_slice(b"ST");
        setup[142..144].copy_from_slice(&(self.setup_bytes as u16).to_le_bytes());
        let fields = [(768, self.rate_hz), (896, self.real_bits)];
        for (at, value) in fields.iter().chain(&self.setup) {
            if let Some(field) = setup.get_mut(*at..at + 4) {
                field.copy_from_slice(&value.to_le_bytes());
            }
        }
        setup
    }
}

/// The block of image times, with flags in the lowest two bits.
fn time_block(times_s: &[f64]) -> Vec<u8> {
    let mut block = (8 + 8 * times_s.len() as u32).to_le_bytes().to_vec();
    block.extend([1002_u16.to_le_bytes(), 0_u16.to_le_bytes()].concat());
    for (index, time_s) in times_s.iter().enumerate() {
        let parts = (time_s * 2_f64.powi(32)).round() as i64;
        let time = ((Cine::TRIGGER_S << 32) as i64 + parts) as u64;
        block.extend((time & !3 | (index as u64 % 4)).to_le_bytes());
    }
    block
}

/// The values of a field of a TIFF directory.
#[derive(Debug, Clone)]
pub enum Field {
    Short(Vec<u16>),
    Long(Vec<u32>),
    Text(String),
    Ratio(u32, u32),
}

/// A page of a TIFF file: tags and stored bytes.
#[derive(Debug, Clone)]
pub struct TiffPage {
    pub fields: Vec<(u16, Field)>,
    pub pixels: Vec<u8>,
}

impl TiffPage {
    /// A grey page of `bits`; `fields` are added or replace those of a plain page.
    pub fn new(size: [u32; 2], bits: u16, pixels: Vec<u8>, fields: &[(u16, Field)]) -> Self {
        let plain = [
            (256, Field::Long(vec![size[0]])),
            (257, Field::Long(vec![size[1]])),
            (258, Field::Short(vec![bits])),
            (259, Field::Short(vec![1])),
            (262, Field::Short(vec![1])),
            (277, Field::Short(vec![1])),
            (278, Field::Long(vec![size[1]])),
        ];
        let mut all: std::collections::BTreeMap<u16, Field> = plain.into_iter().collect();
        all.extend(fields.iter().cloned());
        Self { fields: all.into_iter().collect(), pixels }
    }
}

/// A TIFF file in which the pixels of each page are one strip; those of planes are one strip each.
pub fn tiff_file(kind: Kind, pages: &[TiffPage]) -> Vec<u8> {
    let is_little = kind == Kind::Little;
    assert!(is_little || kind == Kind::Big);
    let short = |value: u16| if is_little { value.to_le_bytes() } else { value.to_be_bytes() };
    let long = |value: u32| if is_little { value.to_le_bytes() } else { value.to_be_bytes() };
    let mut file = if is_little { b"II".to_vec() } else { b"MM".to_vec() };
    file.extend(short(42));
    file.extend(long(8));
    for (index, page) in pages.iter().enumerate() {
        let is_planar = page.fields.iter().any(|field| matches!(field, (284, Field::Short(kind)) if kind == &[2]));
        let strips = if is_planar { 3 } else { 1 };
        let strip_bytes = page.pixels.len() / strips;
        let mut fields = page.fields.clone();
        fields.push((273, Field::Long(vec![0; strips])));
        fields.push((279, Field::Long(vec![strip_bytes as u32; strips])));
        fields.sort_by_key(|(tag, _)| *tag);
        // Values of more than four bytes lie behind the directory, and the pixels behind them.
        let values_at = file.len() + 2 + 12 * fields.len() + 4;
        let length = |field: &Field| match field {
            Field::Short(values) => 2 * values.len(),
            Field::Long(values) => 4 * values.len(),
            Field::Text(text) => text.len() + 1,
            Field::Ratio(..) => 8,
        };
        let outside: usize = fields.iter().map(|(_, field)| length(field)).filter(|bytes| *bytes > 4).sum();
        let pixels_at = values_at + outside;
        let offsets = (0..strips).map(|strip| (pixels_at + strip * strip_bytes) as u32).collect();
        fields.iter_mut().filter(|(tag, _)| *tag == 273).for_each(|field| field.1 = Field::Long(Vec::clone(&offsets)));
        let (mut directory, mut values) = (short(fields.len() as u16).to_vec(), Vec::new());
        for (tag, field) in &fields {
            let (code, count, bytes): (u16, usize, Vec<u8>) = match field {
                Field::Short(list) => (3, list.len(), list.iter().flat_map(|value| short(*value)).collect()),
                Field::Long(list) => (4, list.len(), list.iter().flat_map(|value| long(*value)).collect()),
                Field::Text(text) => (2, text.len() + 1, [text.as_bytes(), &[0]].concat()),
                Field::Ratio(over, under) => (5, 1, [long(*over), long(*under)].concat()),
            };
            directory.extend([short(*tag), short(code)].concat());
            directory.extend(long(count as u32));
            if bytes.len() > 4 {
                directory.extend(long((values_at + values.len()) as u32));
                values.extend(bytes);
            } else {
                directory.extend(&bytes);
                directory.extend(vec![0; 4 - bytes.len()]);
            }
        }
        let end = pixels_at + page.pixels.len();
        directory.extend(long(if index + 1 < pages.len() { end as u32 } else { 0 }));
        file.extend(directory);
        file.extend(values);
        file.extend(&page.pixels);
    }
    file
}

/// A CIH header of lines `name : value`, with the line ends of Windows.
pub fn cih(entries: &[(&str, &str)], separator: &str) -> String {
    let lines = entries.iter().map(|(name, value)| format!("{name}{separator}{value}\r\n"));
    format!("#Camera Information Header\r\n{}END\r\n", lines.collect::<String>())
}
