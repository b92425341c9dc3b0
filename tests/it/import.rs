//! Files of other programs.

use image::{GrayImage, ImageBuffer, Luma, RgbImage};
use ricochet::command;
use ricochet::image::{FrameMeta, PixelFormat};
use ricochet::import::{self, ImportError};
use ricochet::recording::Recording;
use std::fs;
use std::path::{Path, PathBuf};

pub mod encoders;
pub mod films;
pub mod pages;
mod variants;

use pages::{Kind, page_of, tiff};

fn frames(inputs: &[PathBuf], fps: Option<f64>) -> Vec<(FrameMeta, Vec<u8>)> {
    import::open(inputs, fps).unwrap().map(Result::unwrap).collect()
}

fn refusal(inputs: &[PathBuf], fps: Option<f64>) -> String {
    let error = match import::open(inputs, fps) {
        Err(error) => error,
        Ok(footage) => footage.map(|frame| frame.map(|_| ())).find_map(Result::err).expect("it is refused"),
    };
    let line = error.to_string();
    assert!(!line.contains('\n'), "{line}");
    line
}

#[test]
fn stills_of_every_kind_make_a_sequence_with_exact_pixels_and_stamps() {
    let folder = tempfile::tempdir().unwrap();
    let shade = |x: u32, y: u32, k: u32| (x * 7 + y * 13 + k * 31) as u8;
    for ending in ["png", "tif", "bmp", "pgm"] {
        let paths: Vec<_> = (0..3).map(|k| folder.path().join(format!("still_{k}.{ending}"))).collect();
        for (k, path) in (0..).zip(&paths) {
            GrayImage::from_fn(9, 5, |x, y| Luma([shade(x, y, k)])).save(path).unwrap();
        }
        for (k, (meta, pixels)) in (0_u32..).zip(frames(&paths, Some(3000.0))) {
            let expected: Vec<u8> = (0..5).flat_map(|y| (0..9).map(move |x| shade(x, y, k))).collect();
            assert_eq!(pixels, expected, "{ending}");
            assert_eq!((meta.width_px, meta.height_px, meta.stride_bytes), (9, 5, 9));
            assert_eq!((meta.sequence, meta.stamp_ns), (k.into(), [0, 333_333, 666_667][k as usize]));
        }
    }
    for ending in ["png", "tif"] {
        let path = folder.path().join(format!("deep.{ending}"));
        ImageBuffer::from_fn(4, 3, |x, y| Luma([(x * 1000 + y * 20_000) as u16])).save(&path).unwrap();
        let read = frames(&[path], Some(1.0));
        let expected: Vec<u8> =
            (0..3_u16).flat_map(|y| (0..4).flat_map(move |x| (x * 1000 + y * 20_000).to_le_bytes())).collect();
        assert_eq!((read[0].0.format, &read[0].1), (PixelFormat::Mono16, &expected), "{ending}");
    }
}

#[test]
fn missing_stills_are_reported_and_keep_their_time() {
    let folder = tempfile::tempdir().unwrap();
    let sequence = |numbers: &[u32]| -> Vec<PathBuf> {
        let paths: Vec<_> = numbers.iter().map(|k| folder.path().join(format!("drop2_{k:04}.png"))).collect();
        paths.iter().for_each(|path| GrayImage::new(4, 4).save(path).unwrap());
        paths
    };
    let numbered = |numbers: &[u32]| {
        let footage = import::open(&sequence(numbers), Some(1000.0)).unwrap();
        let warnings = footage.warnings.len();
        let metas: Vec<_> = footage.map(|frame| frame.unwrap().0).collect();
        assert!(metas.iter().all(|meta| meta.stamp_ns == meta.sequence * 1_000_000));
        (metas.iter().map(|meta| meta.sequence).collect::<Vec<_>>(), warnings)
    };
    assert_eq!(numbered(&[7, 8, 9, 12, 13]), (vec![0, 1, 2, 5, 6], 1));
    assert_eq!(numbered(&[0, 5, 10, 20]), (vec![0, 1, 2, 4], 1));
    assert_eq!(numbered(&[3, 2, 1]), (vec![0, 1, 2], 1), "the order given is the order");
    assert_eq!(numbered(&[1, 3, 6]), (vec![0, 2, 5], 3), "a step of one frame, with two gaps");
}

#[test]
fn stills_listed_by_a_shell_are_taken_by_their_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let at = |k: u8| folder.path().join(format!("drop_{k}.png"));
    (8..=11).for_each(|k| GrayImage::from_pixel(4, 4, Luma([k])).save(at(k)).unwrap());
    let levels = |order: [u8; 4]| {
        let footage = import::open(&order.map(at), Some(1000.0)).unwrap();
        let message = footage.warnings.join("\n");
        (footage.map(|frame| frame.unwrap().1[0]).collect::<Vec<_>>(), message)
    };
    // The order of a shell for `drop_*.png`.
    let (read, message) = levels([10, 11, 8, 9]);
    assert_eq!(read, [8, 9, 10, 11]);
    assert!(message.contains("2 before 10") && message.lines().count() == 1, "{message}");
    assert_eq!(levels([8, 9, 10, 11]), (vec![8, 9, 10, 11], String::new()));
    assert_eq!(levels([11, 10, 9, 8]).0, [11, 10, 9, 8], "an order that no shell gives is meant");
}

#[test]
fn inputs_that_cannot_be_measured_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    RgbImage::from_pixel(4, 4, image::Rgb([1, 2, 3])).save(at("colour.png")).unwrap();
    GrayImage::new(4, 4).save(at("small.png")).unwrap();
    GrayImage::new(8, 4).save(at("large.png")).unwrap();
    fs::write(at("text.png"), "not an image").unwrap();
    fs::write(at("pages.tif"), tiff(Kind::Little, &[page_of(4, 4, 0), page_of(4, 4, 1)])).unwrap();
    assert!(refusal(&[at("pages.tif"), at("small.png")], Some(1.0)).contains("more than one page"));
    assert!(refusal(&[at("small.png"), at("pages.tif")], Some(1.0)).contains("more than one page"));
    let unequal = tiff(Kind::Little, &[page_of(4, 4, 0), page_of(5, 4, 1)]);
    fs::write(at("unequal.tif"), unequal).unwrap();
    assert!(refusal(&[at("unequal.tif")], Some(1.0)).contains("5x4"));
    let colour = import::open(&[at("colour.png")], Some(1.0)).unwrap();
    assert!(colour.summary().contains("grey from colour by ITU-R BT.601"), "{}", colour.summary());
    assert!(refusal(&[at("small.png"), at("large.png")], Some(1.0)).contains("large.png"));
    assert!(refusal(&[at("text.png")], Some(1.0)).contains("text.png"));
    assert!(refusal(&[at("missing.png")], Some(1.0)).contains("missing.png"));
    assert!(refusal(&[at("small.png")], None).contains("--fps"), "a rate is never guessed");
    assert!(refusal(&[at("small.png")], Some(f64::NAN)).contains("NaN"));
    assert!(refusal(&[at("film.xyz")], Some(1.0)).contains("xyz"));
    assert!(matches!(import::open(&[], None), Err(ImportError::Nothing)));
}

fn cihx(width: u32, height: u32, frames: u32, bits: [u32; 2], side: &str) -> String {
    format!(
        "\u{1}\u{2}<other/><cih><imageDataInfo><resolution><width>{width}</width><height>{height}</height></resolution>\
         <colorInfo><type>Mono</type><bit>{}</bit></colorInfo><effectiveBit><depth>{}</depth><side>{side}</side>\
         </effectiveBit></imageDataInfo><frameInfo><totalFrame>{frames}</totalFrame></frameInfo>\
         <recordInfo><recordRate>10000</recordRate></recordInfo></cih>",
        bits[0], bits[1]
    )
}

/// Packs values bit by bit, high bits first.
fn pack(values: &[u16], bits: u32) -> Vec<u8> {
    let mut packed = vec![0_u8; (values.len() * bits as usize).div_ceil(8)];
    let all = values.iter().flat_map(|value| (0..bits).rev().map(move |bit| value >> bit & 1));
    all.enumerate().for_each(|(at, bit)| packed[at / 8] |= (bit as u8) << (7 - at % 8));
    packed
}

#[test]
fn an_import_becomes_a_recording_with_the_same_frames() {
    let folder = tempfile::tempdir().unwrap();
    let stills: Vec<_> = [3, 4, 6].iter().map(|k| folder.path().join(format!("still_{k}.png"))).collect();
    for (k, path) in (0..).zip(&stills) {
        GrayImage::from_pixel(5, 4, Luma([k])).save(path).unwrap();
    }
    let output = folder.path().join("shot.mcap");
    let options = command::import::ImportOptions {
        inputs: stills.clone(),
        fps: Some(500.0),
        order: command::image_order::ImageOrder::default(),
        output: output.clone(),
        json: false,
    };
    let imported = command::import::run(&options).unwrap();
    assert_eq!((imported.frames, imported.warnings.len()), (3, 1));
    let recording = Recording::open(&output).unwrap();
    let read: Vec<_> = recording.frames().unwrap().map(Result::unwrap).collect();
    assert_eq!(read, frames(&stills, Some(500.0)));
    assert_eq!(recording.metadata()["frame_rate_hz"], "500");
    assert!(command::import::run(&options).is_err(), "nothing is overwritten");
}

#[test]
fn photron_pixels_of_every_depth_are_read_exactly() {
    let folder = tempfile::tempdir().unwrap();
    let (header, pixels) = (folder.path().join("shot.cihx"), folder.path().join("shot.mraw"));
    let cases = [
        ([8, 8], "Lower", PixelFormat::Mono8),
        ([10, 10], "Lower", PixelFormat::Mono10),
        ([12, 12], "Lower", PixelFormat::Mono12),
        ([16, 12], "Lower", PixelFormat::Mono12),
        ([16, 12], "Higher", PixelFormat::Mono12),
        ([16, 16], "Lower", PixelFormat::Mono16),
    ];
    for (bits, side, format) in cases {
        let depth = bits[1];
        let values: Vec<u16> = (0..3 * 8 * 4_u32).map(|k| (k * 40_503 % (1 << depth)) as u16).collect();
        let shift = if side == "Higher" { 16 - depth } else { 0 };
        let stored = match bits[0] {
            8 => values.iter().map(|value| *value as u8).collect(),
            16 => values.iter().flat_map(|value| (value << shift).to_le_bytes()).collect(),
            bits => pack(&values, bits),
        };
        fs::write(&header, cihx(8, 4, 3, bits, side)).unwrap();
        fs::write(&pixels, stored).unwrap();
        // Either file of the pair may be named.
        for named in [&header, &pixels] {
            let read = frames(std::slice::from_ref(named), None);
            assert_eq!(read.len(), 3);
            let bytes: Vec<u8> = read.iter().flat_map(|(_, bytes)| bytes.clone()).collect();
            let expected: Vec<u8> = match format.bytes_per_pixel() {
                1 => values.iter().map(|value| *value as u8).collect(),
                _ => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            };
            assert_eq!(bytes, expected, "{bits:?} {side}");
            assert_eq!((read[2].0.format, read[2].0.stamp_ns), (format, 200_000));
        }
    }
}

#[test]
fn impossible_photron_headers_are_refused_and_missing_frames_reported() {
    let folder = tempfile::tempdir().unwrap();
    let (header, pixels) = (folder.path().join("shot.cihx"), folder.path().join("shot.mraw"));
    fs::write(&header, cihx(8, 4, 3, [8, 8], "Lower")).unwrap();
    assert!(refusal(std::slice::from_ref(&header), None).contains(".mraw"));
    fs::write(&pixels, [0; 70]).unwrap();
    let footage = import::open(std::slice::from_ref(&header), None).unwrap();
    assert_eq!((footage.count, footage.warnings.len()), (2, 1));
    let bad = [
        cihx(0, 4, 3, [8, 8], "Lower"),
        cihx(u32::MAX, u32::MAX, 3, [16, 16], "Lower"),
        cihx(8, 4, 3, [24, 24], "Lower"),
        cihx(3, 1, 3, [12, 12], "Lower"),
        cihx(8, 4, 3, [8, 8], "Lower").replace("Mono", "Infrared"),
        cihx(8, 4, 3, [8, 8], "Lower").replace("10000", "fast"),
        cihx(8, 4, 3, [8, 8], "Lower").replace("<width>", "<w>"),
        "<cih>".into(),
        String::new(),
    ];
    for text in bad {
        fs::write(&header, &text).unwrap();
        assert!(refusal(std::slice::from_ref(&header), None).contains("shot.cihx"), "{text}");
    }
}

/// A CINE file with the given bitmap height (negative: top row first) and rows of bytes.
fn cine(width: i32, height: i32, bits: u16, real_bits: u32, images: &[Vec<u8>]) -> Vec<u8> {
    let (bitmap_at, setup_at, setup_bytes) = (44_u32, 84_u32, 1000_u32);
    let table_at = setup_at + setup_bytes;
    let mut file = Vec::new();
    file.extend(b"CI");
    file.extend(44_u16.to_le_bytes());
    file.extend([0_u8; 2]);
    file.extend(1_u16.to_le_bytes());
    file.extend((-2_i32).to_le_bytes());
    file.extend(99_u32.to_le_bytes());
    file.extend((-2_i32).to_le_bytes());
    file.extend((images.len() as u32).to_le_bytes());
    [bitmap_at, setup_at, table_at].iter().for_each(|at| file.extend(at.to_le_bytes()));
    file.extend((1_u32 << 31).to_le_bytes());
    file.extend(1000_u32.to_le_bytes());
    file.extend(40_u32.to_le_bytes());
    file.extend(width.to_le_bytes());
    file.extend(height.to_le_bytes());
    file.extend(1_u16.to_le_bytes());
    file.extend(bits.to_le_bytes());
    file.extend([0; 24]);
    let mut setup = vec![0_u8; setup_bytes as usize];
    setup[140..142].copy_from_slice(b"ST");
    setup[142..144].copy_from_slice(&(setup_bytes as u16).to_le_bytes());
    setup[768..772].copy_from_slice(&1000_u32.to_le_bytes());
    setup[896..900].copy_from_slice(&real_bits.to_le_bytes());
    file.extend(setup);
    let mut at = u64::from(table_at) + 8 * images.len() as u64;
    for image in images {
        file.extend(at.to_le_bytes());
        at += 12 + image.len() as u64;
    }
    for image in images {
        file.extend(12_u32.to_le_bytes());
        file.extend([9; 4]);
        file.extend((image.len() as u32).to_le_bytes());
        file.extend(image);
    }
    file
}

fn write_cine(folder: &Path, bytes: &[u8]) -> [PathBuf; 1] {
    let path = folder.join("shot.cine");
    fs::write(&path, bytes).unwrap();
    [path]
}

#[test]
fn phantom_images_are_upright_in_either_storage_order() {
    let folder = tempfile::tempdir().unwrap();
    let rows: Vec<Vec<u8>> = (0..3_u8).map(|y| (0..8).map(|x| x + 4 * y).collect()).collect();
    let upright = rows.concat();
    let upside_down: Vec<u8> = rows.iter().rev().flatten().copied().collect();
    for (height, stored) in [(3, &upside_down), (-3, &upright)] {
        let read = frames(&write_cine(folder.path(), &cine(8, height, 8, 8, &[stored.clone(), stored.clone()])), None);
        assert_eq!(read.len(), 2);
        assert!(read.iter().all(|(_, pixels)| *pixels == upright));
        // Trigger at 1000.5 s, two images before it at 1000 frames per second.
        assert_eq!([read[0].0.stamp_ns, read[1].0.stamp_ns], [1_000_498_000_000, 1_000_499_000_000]);
        let deep = frames(&write_cine(folder.path(), &cine(4, height, 16, 12, std::slice::from_ref(stored))), None);
        assert_eq!((deep[0].0.format, &deep[0].1), (PixelFormat::Mono12, &upright));
    }
}

#[test]
fn a_phantom_file_whose_images_begin_at_one_place_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut file = cine(8, 3, 8, 8, &vec![vec![1; 24]; 3]);
    let table = 84 + 1000;
    let first = file[table..table + 8].to_vec();
    file[table + 16..table + 24].copy_from_slice(&first);
    let line = refusal(&write_cine(folder.path(), &file), None);
    assert!(line.contains("images 0 and 2 begin at the same byte, 1108"), "{line}");
}

#[test]
fn packed_phantom_images_are_spread_to_12_bits_top_row_first() {
    let folder = tempfile::tempdir().unwrap();
    // Codes and the levels that Phantom software assigns to them.
    let known =
        [(1, 5), (64, 64), (128, 125), (256, 290), (512, 998), (768, 2267), (900, 3159), (1014, 4064), (1015, 4095)];
    let mut codes: Vec<u16> = (0..1024).collect();
    codes.extend(known.iter().map(|(code, _)| *code as u16));
    codes.resize(1040, 0);
    let mut file = cine(104, 10, 16, 12, &[pack(&codes, 10)]);
    file[44 + 16..44 + 20].copy_from_slice(&256_u32.to_le_bytes());
    let read = frames(&write_cine(folder.path(), &file), None);
    let levels: Vec<i32> = read[0].1.chunks_exact(2).map(|w| i32::from(u16::from_le_bytes([w[0], w[1]]))).collect();
    assert_eq!((read[0].0.format, levels.len()), (PixelFormat::Mono12, 1040));
    assert!(levels[..1024].windows(2).all(|pair| pair[0] <= pair[1]), "brighter codes are brighter levels");
    for ((code, expected), level) in known.iter().zip(&levels[1024..]) {
        assert!((level - expected).abs() <= 1, "code {code}: {level}, expected {expected}");
        assert_eq!(*level, levels[*code as usize]);
    }
    file[44 + 16..44 + 20].copy_from_slice(&1_u32.to_le_bytes());
    assert!(refusal(&write_cine(folder.path(), &file), None).contains("compression 1"));
}

#[test]
fn a_phantom_file_truncated_anywhere_is_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let whole = cine(8, 3, 8, 8, &[vec![1; 24], vec![2; 24]]);
    for length in 0..whole.len() {
        let line = refusal(&write_cine(folder.path(), &whole[..length]), None);
        assert!(line.contains("shot.cine"), "{line}");
    }
}

/// A NumPy array of these bytes.
pub fn npy(kind: &str, order: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let mut text = format!("{{'descr': '{kind}', 'fortran_order': {order}, 'shape': {shape}, }}");
    text.extend(std::iter::repeat_n(' ', 127 - 10 - text.len()));
    text.push('\n');
    [b"\x93NUMPY\x01\0", &(text.len() as u16).to_le_bytes()[..], text.as_bytes(), data].concat()
}

#[test]
fn a_numpy_stack_comes_out_frame_by_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = [folder.path().join("stack.npy")];
    let bytes: Vec<u8> = (0..2 * 3 * 4 * 2).map(|k| (k * 5) as u8).collect();
    let swapped: Vec<u8> = bytes.chunks(2).flat_map(|pair| [pair[1], pair[0]]).collect();
    let cases = [
        ("|u1", "(4, 3, 4)", &bytes, PixelFormat::Mono8, 12),
        ("<u2", "(2, 3, 4)", &bytes, PixelFormat::Mono16, 24),
        (">u2", "(2, 3, 4)", &swapped, PixelFormat::Mono16, 24),
    ];
    for (kind, shape, data, format, frame_bytes) in cases {
        fs::write(&path[0], npy(kind, "False", shape, data)).unwrap();
        let read = frames(&path, Some(2000.0));
        assert_eq!(read.len(), bytes.len() / frame_bytes, "{kind}");
        for (k, (meta, pixels)) in read.iter().enumerate() {
            assert_eq!((meta.width_px, meta.height_px, meta.format), (4, 3, format));
            assert_eq!((meta.sequence, meta.stamp_ns), (k as u64, k as u64 * 500_000));
            assert_eq!(pixels, &bytes[k * frame_bytes..][..frame_bytes], "{kind}");
        }
    }
    assert!(refusal(&path, None).contains("--fps"));
}

#[test]
fn a_numpy_array_that_is_no_stack_of_frames_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = [folder.path().join("stack.npy")];
    let data = [7; 24];
    let bad = [
        (npy("<f4", "False", "(2, 3, 4)", &data), "'<f4'"),
        (npy("|b1", "False", "(2, 3, 4)", &data), "255 * a"),
        (npy("<i2", "False", "(1, 3, 4)", &data), "positive"),
        (npy("|u1", "False", "(24,)", &data), "(24,)"),
        (npy("|u1", "False", "(2, 3, 2, 2)", &data), "(2, 3, 2, 2)"),
        (npy("|u1", "False", "(0, 3, 4)", &[]), "0 frames"),
        (npy("|u1", "False", "(2, 0, 4)", &[]), "4x0"),
        (npy("|u1", "False", "(2, 3, 4)", &[7; 23]), "23 bytes"),
        (npy("|u1", "False", "(2, 3, 4)", &[7; 25]), "25 bytes"),
        (npy("|u1", "False", "(18446744073709551615, 3, 4)", &data), "18446744073709551615 frames"),
        (npy("|u1", "False", "(2, 4294967296, 4294967296)", &data), "4294967296x4294967296"),
        (npy("|u1", "False", "(1, 1, 8589934592)", &data), "8589934592x1"),
        (npy("|u1", "False", "(2, -3, 4)", &data), "(2, -3, 4)"),
        (npy("|u1", "False", "2", &data), "of shape 2"),
        (npy("|u1", "No", "(2, 3, 4)", &data), "fortran_order is No"),
        (b"\x93NUMPY\x09\0".to_vec(), "version 9"),
        (b"\x93NUMPY\x02\0\xff\xff\xff\xff".to_vec(), "4294967295 bytes"),
        (b"not an array".to_vec(), "magic"),
    ];
    for (bytes, message) in bad {
        fs::write(&path[0], bytes).unwrap();
        let line = refusal(&path, Some(1.0));
        assert!(line.contains("stack.npy") && line.contains(message), "{line}");
    }
    let whole = npy("|u1", "False", "(2, 3, 4)", &data);
    for length in 0..whole.len() {
        fs::write(&path[0], &whole[..length]).unwrap();
        assert!(refusal(&path, Some(1.0)).contains("stack.npy"), "cut at {length}");
    }
}

#[test]
fn a_stack_that_numpy_saved_has_its_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stack.npy");
    let script =
        "import numpy, sys; a = numpy.arange(5 * 6 * 7, dtype='u2').reshape(5, 6, 7) * 301; numpy.save(sys.argv[1], a)";
    if crate::support::python(script, &[&path]).is_none() {
        return;
    }
    let pixels: Vec<u8> = frames(&[path], Some(1.0)).into_iter().flat_map(|(_, pixels)| pixels).collect();
    let expected: Vec<u8> = (0..5 * 6 * 7_u16).flat_map(|k| k.wrapping_mul(301).to_le_bytes()).collect();
    assert_eq!(pixels, expected);
}

#[test]
fn arrays_of_other_shapes_and_orders_have_the_same_frames() {
    let folder = tempfile::tempdir().unwrap();
    let path = [folder.path().join("stack.npy")];
    let at = |k: usize, y: usize, x: usize| (100 * k + 10 * y + x) as u8;
    let expected: Vec<u8> = (0..2).flat_map(|k| (0..3).flat_map(move |y| (0..4).map(move |x| at(k, y, x)))).collect();
    let fortran: Vec<u8> = (0..4).flat_map(|x| (0..3).flat_map(move |y| (0..2).map(move |k| at(k, y, x)))).collect();
    let colours: Vec<u8> = expected.iter().flat_map(|level| [*level; 3]).collect();
    let all = |file: Vec<u8>| -> Vec<u8> {
        fs::write(&path[0], file).unwrap();
        frames(&path, Some(1.0)).into_iter().flat_map(|(_, pixels)| pixels).collect()
    };
    assert_eq!(all(npy("|u1", "True", "(2, 3, 4)", &fortran)), expected);
    assert_eq!(all(npy("|u1", "False", "(2, 3, 4, 3)", &colours)), expected);
    assert_eq!(all(npy("|u1", "False", "(2, 3, 4, 1)", &expected)), expected);
    assert_eq!(all(npy("|u1", "False", "(6, 4)", &expected)), expected, "one frame");
    let archive = [folder.path().join("stack.npz")];
    assert!(refusal(&archive, Some(1.0)).contains("numpy.save"));
}

/// A small file of every kind, with its file extension.
pub fn seeds() -> Vec<(&'static str, Vec<u8>)> {
    let folder = tempfile::tempdir().unwrap();
    let still = |ending: &'static str| {
        let path = folder.path().join(format!("still{ending}"));
        GrayImage::from_fn(6, 4, |x, y| Luma([(x * 9 + y) as u8])).save(&path).unwrap();
        (ending, fs::read(&path).unwrap())
    };
    let mut packed = cine(8, 3, 16, 12, &[pack(&[500; 24], 10)]);
    packed[44 + 16..44 + 20].copy_from_slice(&256_u32.to_le_bytes());
    let mut seeds: Vec<_> = [".png", ".tif", ".bmp", ".pgm"].into_iter().map(still).collect();
    let pages = [pages::page_of(4, 4, 0), pages::page_of(4, 4, 1)];
    seeds.extend(pages::KINDS.map(|kind| (".tif", pages::tiff(kind, &pages))));
    seeds.extend([
        (".cine", cine(8, 3, 8, 8, &[vec![1; 24], vec![2; 24]])),
        (".cine", packed),
        (".cihx", cihx(8, 4, 3, [8, 8], "Lower").into_bytes()),
        (".cihx", cihx(8, 4, 2, [12, 12], "Lower").into_bytes()),
        (".npy", npy("<u2", "False", "(2, 3, 4)", &[7; 48])),
        (".npy", npy("|u1", "True", "(2, 3, 4)", &[7; 24])),
    ]);
    seeds.extend(variants::seeds());
    seeds
}

/// The directory of real recordings, if it was named.
fn real_data() -> Option<PathBuf> {
    let folder = std::env::var_os("RICOCHET_REAL_DATA").map(PathBuf::from);
    if folder.is_none() {
        eprintln!("left out: RICOCHET_REAL_DATA does not name the folder of real recordings");
    }
    folder.map(|folder| folder.join("highspeed-formats"))
}

#[test]
fn a_real_phantom_file_equals_the_reference_to_the_pixel() {
    let Some(folder) = real_data() else { return };
    let read = frames(&[folder.join("phantom_v1610.cine")], None);
    assert_eq!(read.len(), 6);
    for (k, (meta, pixels)) in read.iter().enumerate() {
        assert_eq!((meta.width_px, meta.height_px), (256, 128));
        // Three int32, then float32 row by row.
        let reference = fs::read(folder.join(format!("phantom_v1610_{k}.rawi"))).unwrap();
        let values = reference[12..].chunks_exact(4).map(|v| f32::from_le_bytes(v.try_into().unwrap()));
        assert!(values.eq(pixels.iter().map(|pixel| f32::from(*pixel))), "frame {k}");
    }
}

#[test]
fn a_real_photron_file_is_read_with_its_rate_and_depth() {
    let Some(folder) = real_data() else { return };
    let footage = import::open(&[folder.join("beam.cihx")], None).unwrap();
    assert_eq!((footage.width_px, footage.height_px, footage.count), (1024, 80, 4));
    assert_eq!((footage.format, footage.frame_rate_hz), (PixelFormat::Mono12, 50_000.0));
    assert_eq!(footage.description["camera"], "FASTCAM SA-Z type 2100K-M-64GB");
    let stored = fs::read(folder.join("beam.mraw")).unwrap();
    let pixels: Vec<u8> = footage.flat_map(|frame| frame.unwrap().1).collect();
    assert_eq!(pixels, stored);
}
