//! Depths, colours, orders and times of files, read exactly.

use super::encoders::{Cine, Field, TiffPage, cih, tiff_file};
use super::films::scene::{Ball, stack};
use super::pages::Kind;
use super::{frames, pack, refusal};
use crate::support::{csv, ricochet};
use image::{GrayImage, Luma};
use ricochet::image::PixelFormat;
use ricochet::import::{self, Order};
use std::fs;
use std::path::{Path, PathBuf};

fn written(folder: &Path, name: &str, bytes: impl AsRef<[u8]>) -> [PathBuf; 1] {
    let path = folder.join(name);
    fs::write(&path, bytes).unwrap();
    [path]
}

/// Levels that use every bit.
fn levels(count: u32, bits: u32) -> Vec<u16> {
    (0..count).map(|k| (k * 40_503 % (1 << bits)) as u16).collect()
}

fn words(levels: &[u16]) -> Vec<u8> {
    levels.iter().flat_map(|level| level.to_le_bytes()).collect()
}

#[test]
fn packed_and_deep_phantom_images_keep_their_levels() {
    let folder = tempfile::tempdir().unwrap();
    let twelve = levels(96, 12);
    let packed = Cine {
        compression: [0, 1024],
        stored_bits: 16,
        real_bits: 12,
        ..Cine::new([16, 6], 1000, vec![pack(&twelve, 12)])
    };
    let read = frames(&written(folder.path(), "a.cine", packed.bytes()), None);
    assert_eq!((read[0].0.format, &read[0].1), (PixelFormat::Mono12, &words(&twelve)));
    // 14 bits: a negative height has the first row first.
    let fourteen = levels(96, 14);
    let deep = Cine { stored_bits: 16, real_bits: 14, ..Cine::new([16, -6], 1000, vec![words(&fourteen)]) };
    let path = written(folder.path(), "b.cine", deep.bytes());
    assert_eq!(frames(&path, None)[0].1, words(&fourteen));
    assert!(import::open(&path, None).unwrap().summary().contains("14 bit grey"));
    // A level beyond the stated bits is named, and none is cut off.
    let wrong = Cine { real_bits: 10, ..deep };
    let footage = import::open(&written(folder.path(), "c.cine", wrong.bytes()), None).unwrap();
    assert!(footage.warnings[0].contains("RealBPP says 10 bits") && footage.format == PixelFormat::Mono16);
}

#[test]
fn phantom_colours_are_measured_by_a_stated_rule_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    // Blue, green and red of one colour.
    let colours =
        Cine { stored_bits: 24, setup: vec![(808, 3)], ..Cine::new([4, 2], 1000, vec![[200, 100, 50].repeat(8)]) };
    let path = written(folder.path(), "a.cine", colours.bytes());
    assert_eq!(frames(&path, None)[0].1, [96; 8], "0.299 * 50 + 0.587 * 100 + 0.114 * 200");
    let mosaic: Vec<u8> = (0..24).map(|at| [[40, 100], [100, 200]][at / 6 % 2][at % 2]).collect();
    let raw = Cine { compression: [2, 0], setup: vec![(808, 3)], ..Cine::new([6, 4], 1000, vec![mosaic]) };
    // Rows of 6 bytes are not padded, since the image has just these.
    let path = written(folder.path(), "b.cine", raw.bytes());
    let footage = import::open(&path, None).unwrap();
    assert!(footage.summary().contains("grey from a Bayer mosaic"), "{}", footage.summary());
    assert_eq!(frames(&path, None)[0].1, [110; 24]);
    let odd = Cine { setup: vec![(808, 0x8000_0003)], ..raw.clone() };
    assert!(refusal(&written(folder.path(), "c.cine", odd.bytes()), None).contains("colour filter 0x80000003"));
    let jpeg = Cine { compression: [1, 0], ..raw };
    assert!(refusal(&written(folder.path(), "d.cine", jpeg.bytes()), None).contains("save it as an uncompressed"));
}

#[test]
fn phantom_rates_come_from_the_best_field_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let images = vec![vec![7; 32]; 4];
    let rate = |cine: Cine| {
        let footage = import::open(&written(folder.path(), "a.cine", cine.bytes()), None).unwrap();
        (footage.frame_rate_hz, footage.summary(), footage.warnings.join("\n"))
    };
    let plain = Cine::new([8, 4], 24, images.clone());
    let exact = 23.976_f64.to_bits();
    let exact = Cine { setup: vec![(10_400, exact as u32), (10_404, (exact >> 32) as u32)], ..plain.clone() };
    assert_eq!(rate(exact.clone()).0, 23.976);
    assert!(rate(Cine { rate_hz: 48, ..exact }).2.contains("dFrameRate says 23.976 frames/s, but FrameRate 48"));
    let (hz, line, _) = rate(Cine { setup_bytes: 144, ..plain.clone() });
    assert!(hz == 24.0 && line.contains("FrameRate16"), "{line}");
    // A profile: 24 Hz up to image 1, then 240 Hz.
    let setup = vec![(1048, 1), (1052, 1), (1116, 240)];
    let profiled = written(folder.path(), "b.cine", Cine { setup, first_image: -1, ..plain.clone() }.bytes());
    let footage = import::open(&profiled, None).unwrap();
    assert!(footage.warnings[0].contains("at image 1 to 240 frames/s"), "{:?}", footage.warnings);
    let stamps: Vec<u64> = frames(&profiled, None).iter().map(|(meta, _)| meta.stamp_ns).collect();
    let since: Vec<u64> = stamps.iter().map(|stamp| (stamp - stamps[0]).div_ceil(1000)).collect();
    assert_eq!(since, [0, 41_667, 83_334, 87_500]);
    // Times that fall are no times.
    let (hz, _, warnings) = rate(Cine { times_s: Some(vec![0.0, 0.2, 0.1, 0.3]), ..plain });
    assert!(hz == 24.0 && warnings.contains("do not rise"), "{warnings}");
}

#[test]
fn phantom_images_with_other_than_square_pixels_are_resampled() {
    let folder = tempfile::tempdir().unwrap();
    let cine = Cine { per_metre: [20_000, 30_000], ..Cine::new([8, 4], 1000, vec![vec![7; 32]]) };
    let footage = import::open(&written(folder.path(), "a.cine", cine.bytes()), None).unwrap();
    assert_eq!((footage.width_px, footage.height_px), (12, 4));
    assert!(footage.summary().contains("pixels of 1.5000 : 1 made square"), "{}", footage.summary());
    assert_eq!(footage.map(|frame| frame.unwrap().1).next().unwrap(), [7; 48]);
}

#[test]
fn tiff_tags_turn_the_image_and_name_its_bits_and_colours() {
    let folder = tempfile::tempdir().unwrap();
    let open = |page: TiffPage, kind: Kind| {
        let path = written(folder.path(), "a.tif", tiff_file(kind, &[page]));
        let footage = import::open(&path, Some(1.0)).unwrap();
        let (line, size, format) = (footage.summary(), [footage.width_px, footage.height_px], footage.format);
        (line, size, format, footage.map(|frame| frame.unwrap().1).next().unwrap())
    };
    let six = vec![1, 2, 3, 4, 5, 6];
    let turned = TiffPage::new([3, 2], 8, six.clone(), &[(274, Field::Short(vec![6]))]);
    let (line, size, _, pixels) = open(turned, Kind::Little);
    assert!(line.contains("turned by 90 deg clockwise") && size == [2, 3] && pixels == [4, 1, 5, 2, 6, 3], "{line}");
    let white = TiffPage::new([3, 2], 8, six.clone(), &[(262, Field::Short(vec![0]))]);
    assert_eq!(open(white, Kind::Big).3, [254, 253, 252, 251, 250, 249]);
    for (bits, format) in [(10, PixelFormat::Mono10), (12, PixelFormat::Mono12), (14, PixelFormat::Mono16)] {
        // Rows of 5 packed samples end at a byte.
        let levels = levels(10, bits);
        let packed = [pack(&levels[..5], bits), pack(&levels[5..], bits)].concat();
        for kind in [Kind::Little, Kind::Big] {
            let (line, _, read_format, pixels) = open(TiffPage::new([5, 2], bits as u16, packed.clone(), &[]), kind);
            assert_eq!((read_format, pixels), (format, words(&levels)), "{kind:?}, {bits} bits");
            assert!(line.contains(&format!("{bits} bit grey")), "{line}");
        }
    }
    let rgb = |planar: u16, pixels: Vec<u8>| {
        let fields = [(258, Field::Short(vec![8; 3])), (262, Field::Short(vec![2])), (277, Field::Short(vec![3]))];
        let fields: Vec<(u16, Field)> = fields.into_iter().chain([(284, Field::Short(vec![planar]))]).collect();
        TiffPage::new([2, 1], 8, pixels, &fields)
    };
    for page in [rgb(1, vec![50, 100, 200, 0, 255, 0]), rgb(2, vec![50, 0, 100, 255, 200, 0])] {
        let (line, _, _, pixels) = open(page, Kind::Little);
        assert!(pixels == [96, 150] && line.contains("BT.601"), "{line} {pixels:?}");
    }
    // The table of colours holds 65535 - 257 k; ImageJ only shows levels through it.
    let table = (0..3).flat_map(|_| (0..256).map(|k| 65_535 - 257 * k)).collect();
    let palette = [(262, Field::Short(vec![3])), (320, Field::Short(table))];
    let (_, _, _, pixels) = open(TiffPage::new([3, 2], 8, six.clone(), &palette), Kind::Little);
    assert_eq!(pixels, [254, 253, 252, 251, 250, 249]);
    let shown: Vec<(u16, Field)> = palette.into_iter().chain([(270, Field::Text("ImageJ=1.53t\n".into()))]).collect();
    assert_eq!(open(TiffPage::new([3, 2], 8, six, &shown), Kind::Big).3, [1, 2, 3, 4, 5, 6]);
    let aspect = [(282, Field::Ratio(200, 1)), (283, Field::Ratio(300, 1))];
    assert_eq!(open(TiffPage::new([8, 2], 8, vec![9; 16], &aspect), Kind::Big).1, [12, 2]);
    for (format, words) in [(2, "signed"), (3, "floating-point")] {
        let page = TiffPage::new([2, 1], 16, vec![0; 4], &[(339, Field::Short(vec![format]))]);
        let line = refusal(&written(folder.path(), "a.tif", tiff_file(Kind::Little, &[page])), Some(1.0));
        assert!(line.contains(words), "{line}");
    }
}

#[test]
fn descriptions_of_tiff_files_state_rates_and_times() {
    let folder = tempfile::tempdir().unwrap();
    let open = |text: &str, fps: Option<f64>| {
        let page = |fields: &[(u16, Field)]| TiffPage::new([4, 4], 8, vec![7; 16], fields);
        let pages = [page(&[(270, Field::Text(text.into()))]), page(&[]), page(&[])];
        let path = written(folder.path(), "a.tif", tiff_file(Kind::Little, &pages));
        import::open(&path, fps)
    };
    let ome =
        |pixels: &str, planes: &str| format!("<?xml version=\"1.0\"?><OME><Pixels {pixels}>{planes}</Pixels></OME>");
    let stated = open(&ome("SizeT=\"3\" TimeIncrement=\"0.5\" TimeIncrementUnit=\"ms\"", ""), None).unwrap();
    assert!(stated.summary().contains("2000 frames/s by the file's TimeIncrement"), "{}", stated.summary());
    let plane = |ms: &str| format!("<Plane DeltaT=\"{ms}\" DeltaTUnit=\"ms\" TheT=\"0\"/>");
    let times = open(&ome("SizeT=\"3\"", &["0", "1", "4"].map(plane).concat()), None).unwrap();
    assert!(times.summary().contains("2 frames missing"), "{}", times.summary());
    let stamps: Vec<u64> = times.map(|frame| frame.unwrap().0.stamp_ns).collect();
    assert_eq!(stamps, [0, 1_000_000, 4_000_000]);
    let playback = open("ImageJ=1.53t\nimages=3\nfps=7\n", None).unwrap();
    assert!(playback.is_rate_of_playback() && playback.warnings[0].contains("--fps"), "{:?}", playback.warnings);
    let channels = open("ImageJ=1.53t\nimages=3\nchannels=3\n", Some(1.0)).unwrap_err().to_string();
    assert!(channels.contains("3 channels"), "{channels}");
    assert!(open("", None).is_err(), "no rate");
}

#[test]
fn names_order_a_sequence_or_leave_it_open() {
    let folder = tempfile::tempdir().unwrap();
    let read = |names: &[&str], fps: Option<f64>, order: Order| {
        let paths: Vec<PathBuf> = names.iter().map(|name| folder.path().join(format!("{name}.png"))).collect();
        for (k, path) in (0..).zip(&paths) {
            GrayImage::from_pixel(2, 2, Luma([k])).save(path).unwrap();
        }
        let footage = import::open_in_order(&paths, fps, order).map_err(|error| error.to_string())?;
        let warnings = footage.warnings.join("\n");
        let frames = footage.map(Result::unwrap).map(|(meta, pixels)| (pixels[0], meta.stamp_ns));
        Ok::<_, String>((frames.collect::<Vec<_>>(), warnings))
    };
    let order = |names: &[&str]| {
        let frames = read(names, Some(1000.0), Order::Forward)?.0;
        Ok::<Vec<u8>, String>(frames.into_iter().map(|(level, _)| level).collect())
    };
    // Dates, times since 1970 and units are times.
    let dates = ["d_2024-05-01_12-00-00.0003", "d_2024-05-01_12-00-00.0001", "d_2024-05-01_11-59-59.9999"];
    let by_date = read(&dates, Some(1000.0), Order::Forward).unwrap().0;
    assert_eq!(by_date.iter().map(|(level, _)| *level).collect::<Vec<_>>(), [0, 1, 2], "an order that no shell gives");
    let mut listed = dates;
    listed.sort_unstable();
    let by_date = read(&listed, None, Order::Forward).unwrap().0;
    assert_eq!(by_date[2].1 - by_date[0].1, 400_000);
    let by_epoch = read(&["1714564800000000000", "1714564800000200000", "1714564800000600000"], None, Order::Forward);
    let stamps: Vec<u64> = by_epoch.unwrap().0.iter().map(|frame| frame.1).collect();
    assert_eq!([stamps[1] - stamps[0], stamps[2] - stamps[0]], [200_000, 600_000]);
    let by_unit = read(&["t_0.2ms", "t_0.4ms", "t_0.6ms"], None, Order::Forward).unwrap().0;
    assert_eq!(by_unit[2].1 - by_unit[0].1, 400_000);
    // A date in whole seconds next to a counter times nothing.
    let counted = ["c_2024-05-01_12-00-00_0009", "c_2024-05-01_12-00-00_0010", "c_2024-05-01_12-00-01_0012"];
    let (frames, warnings) = read(&counted, Some(1000.0), Order::Forward).unwrap();
    assert_eq!(frames, [(0, 0), (1, 1_000_000), (2, 3_000_000)], "{warnings}");
    // Decimal numbers and several numbers that rise together.
    assert_eq!(order(&["e_0.9", "e_1.0", "e_1.1"]), Ok(vec![0, 1, 2]));
    assert_eq!(order(&["f_1_t100", "f_10_t1000", "f_2_t200"]), Ok(vec![0, 2, 1]));
    for (names, words) in [
        (&["g_1_3", "g_2_2", "g_3_1"][..], "the order is not clear"),
        (&["h_1_1", "h_1_2", "h_2_1", "h_2_2"], "more than one running number"),
        (&["i_01", "i_1"], "same number"),
        (&["k_1", "k_2", "k_3", "reference"], "reference.png"),
    ] {
        let line = order(names).unwrap_err();
        assert!(line.contains(words), "{line}");
    }
    let (frames, warnings) = read(&["l_1", "l_2", "l_5"], Some(1000.0), Order::Reversed).unwrap();
    assert_eq!(frames, [(2, 0), (1, 3_000_000), (0, 4_000_000)], "{warnings}");
    let (_, warnings) = read(&["m-1", "m-2", "m-3"], Some(1000.0), Order::Forward).unwrap();
    assert!(warnings.contains("--reverse"), "{warnings}");
    let (_, warnings) = read(&["north", "south"], Some(1000.0), Order::Forward).unwrap();
    assert!(warnings.contains("no number in common"), "{warnings}");
}

#[test]
fn a_proposal_for_reversed_images_measures_them_reversed() {
    let folder = tempfile::tempdir().unwrap();
    let images = folder.path().join("images");
    fs::create_dir(&images).unwrap();
    let ball = Ball::default();
    let [width, height] = Ball::SIZE;
    for k in 0..24 {
        let picture = GrayImage::from_raw(width, height, ball.picture(f64::from(k), k)).unwrap();
        picture.save(images.join(format!("f_{k:02}.png"))).unwrap();
    }
    let among = ricochet(["setup", "."]).current_dir(&images).output().unwrap();
    assert!(String::from_utf8_lossy(&among.stderr).contains("rig.png would lie among the images"), "{among:?}");
    let command = |name: &str, rest: &[&str]| {
        let mut command = ricochet([name]);
        command.args(["images", "--fps", "500", "--reverse"]).args(rest).current_dir(folder.path());
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let printed = command("setup", &["--diameter-mm", "40", "-o", "rig.toml"]);
    assert!(printed.contains("--fps 500 --reverse --config rig.toml"), "{printed}");
    command("analyze", &["--config", "rig.toml", "-o", "reversed.mcap"]);
    let rows = csv(&folder.path().join("reversed.mcap"), "velocity");
    let column = |row: &str, name: &str| {
        let at = rows.lines().next().unwrap().split(',').position(|title| title == name).unwrap();
        row.split(',').nth(at).unwrap().parse::<f64>().unwrap_or(f64::NAN)
    };
    // The ball moves to the right and down; reversed, to the left and up.
    let row = rows.lines().nth(12).unwrap();
    assert!(column(row, "vx_m_s") < -0.1 && column(row, "vy_m_s") > 0.05, "{rows}");
    command("diagnose", &["--config", "rig.toml", "-o", "page.html"]);
    let film = stack(folder.path(), (0..4).map(|k| ball.picture(f64::from(k), k)));
    let output = ricochet(["setup".as_ref(), film.as_os_str(), "--reverse".as_ref()]).output().unwrap();
    assert!(String::from_utf8_lossy(&output.stderr).contains("only the images of a sequence can be reversed"));
}

#[test]
fn folders_and_patterns_are_sequences_of_one_kind() {
    let folder = tempfile::tempdir().unwrap();
    let save =
        |name: &str, level: u8| GrayImage::from_pixel(2, 2, Luma([level])).save(folder.path().join(name)).unwrap();
    (0..12).for_each(|k| save(&format!("p{k}.png"), 20 * k));
    fs::write(folder.path().join("notes.txt"), "no image").unwrap();
    let levels = |input: PathBuf| -> Vec<u8> {
        assert!(import::is_importable(&input));
        frames(&[input], Some(1.0)).iter().map(|(_, pixels)| pixels[0]).collect()
    };
    assert_eq!(levels(folder.path().to_path_buf()), (0..12).map(|k| 20 * k).collect::<Vec<u8>>());
    assert_eq!(levels(folder.path().join("p1*.png")), [20, 200, 220]);
    save("q.bmp", 1);
    assert!(refusal(&[folder.path().to_path_buf()], Some(1.0)).contains("end in png and in bmp"));
    assert!(refusal(&[folder.path().join("z*.png")], Some(1.0)).contains("no images"));
}

/// A JPEG file with an Exif orientation.
pub fn jpeg(orientation: u8) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    // Dark on the left, in blocks that the compression keeps.
    GrayImage::from_fn(32, 16, |x, _| Luma([if x < 16 { 20 } else { 200 }])).save(&path).unwrap();
    let plain = fs::read(&path).unwrap();
    let mut exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
    exif.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
    let segment = [&[0xff, 0xe1][..], &(exif.len() as u16 + 2).to_be_bytes(), &exif].concat();
    [&plain[..2], &segment, &plain[2..]].concat()
}

/// Files with the times, tags and descriptions that importers read.
pub fn seeds() -> Vec<(&'static str, Vec<u8>)> {
    let times_s = Some(vec![-0.003, -0.002, 0.0, 0.001]);
    let timed = Cine { times_s, setup: vec![(756, 1), (884, 90)], ..Cine::new([8, 4], 1000, vec![vec![7; 32]; 4]) };
    let profile = vec![(1048, 2), (1052, 0), (1056, 1), (1116, 500), (1120, 50), (808, 3)];
    let profiled = Cine { setup: profile, first_image: -2, ..Cine::new([8, 4], 1000, vec![vec![7; 32]; 4]) };
    let colours = Cine { stored_bits: 24, per_metre: [100, 150], ..Cine::new([4, 4], 1000, vec![vec![7; 48]; 2]) };
    let text = Field::Text("ImageJ=1.53t\nimages=4\nfinterval=0.001\n".into());
    let stack = TiffPage::new([6, 4], 8, vec![9; 96], &[(270, text)]);
    let ome = "<OME><Pixels SizeT=\"2\" TimeIncrement=\"1\" TimeIncrementUnit=\"ms\"><Plane DeltaT=\"0\" />\
        <Plane DeltaT=\"1\" /></Pixels></OME>";
    let turned = [(270, Field::Text(ome.into())), (274, Field::Short(vec![6])), (282, Field::Ratio(3, 2))];
    let turned: Vec<(u16, Field)> = turned.into_iter().chain([(283, Field::Ratio(1, 1))]).collect();
    let packed = TiffPage::new([6, 4], 12, vec![0x5a; 36], &turned);
    let planes = [(258, Field::Short(vec![8; 3])), (262, Field::Short(vec![2])), (277, Field::Short(vec![3]))];
    let planes: Vec<(u16, Field)> = planes.into_iter().chain([(284, Field::Short(vec![2]))]).collect();
    let planes = TiffPage::new([6, 4], 8, vec![9; 72], &planes);
    let palette = [(262, Field::Short(vec![3])), (320, Field::Short((0..768).map(|k| k * 80).collect()))];
    let palette = TiffPage::new([6, 4], 8, (0..24).collect(), &palette);
    vec![
        (".jpg", jpeg(6)),
        (".cine", timed.bytes()),
        (".cine", profiled.bytes()),
        (".cine", colours.bytes()),
        (".tif", tiff_file(Kind::Little, &[stack])),
        (".tif", tiff_file(Kind::Big, &[packed.clone(), packed])),
        (".tif", tiff_file(Kind::Big, &[planes])),
        (".tif", tiff_file(Kind::Little, &[palette])),
    ]
}

#[test]
fn photographs_are_turned_as_they_were_taken() {
    let folder = tempfile::tempdir().unwrap();
    for (orientation, size, dark_at) in [(1, [32, 16], 0), (3, [32, 16], 511), (6, [16, 32], 0), (8, [16, 32], 511)] {
        let path = written(folder.path(), "a.jpg", jpeg(orientation));
        let footage = import::open(&path, Some(1.0)).unwrap();
        assert_eq!([footage.width_px, footage.height_px], size, "orientation {orientation}");
        let pixels = footage.map(|frame| frame.unwrap().1).next().unwrap();
        assert!(pixels[dark_at] < 40 && pixels[511 - dark_at] > 180, "orientation {orientation}");
    }
}

#[test]
fn stills_with_other_than_square_pixels_are_resampled() {
    let folder = tempfile::tempdir().unwrap();
    let size = |name: &str, bytes: Vec<u8>| {
        let footage = import::open(&written(folder.path(), name, bytes), Some(1.0)).unwrap();
        ([footage.width_px, footage.height_px], footage.summary())
    };
    let path = folder.path().join("plain.png");
    GrayImage::from_fn(8, 4, |x, _| Luma([20 * x as u8])).save(&path).unwrap();
    let png = fs::read(&path).unwrap();
    // A chunk behind the header: pixels per unit along x and y, and no unit.
    let body = [&b"pHYs"[..], &200_u32.to_be_bytes(), &300_u32.to_be_bytes(), &[0]].concat();
    let mut crc = crc32fast::Hasher::new();
    crc.update(&body);
    let chunk = [&9_u32.to_be_bytes()[..], &body, &crc.finalize().to_be_bytes()].concat();
    let (wide, line) = size("wide.png", [&png[..33], &chunk, &png[33..]].concat());
    assert!(wide == [12, 4] && line.contains("pixels of 1.5000 : 1 made square"), "{line}");
    let path = folder.path().join("plain.jpg");
    GrayImage::from_fn(32, 16, |x, _| Luma([7 * x as u8])).save(&path).unwrap();
    let mut jpeg = fs::read(&path).unwrap();
    jpeg[14..18].copy_from_slice(&[0, 2, 0, 1]);
    assert_eq!(size("high.jpg", jpeg).0, [32, 32]);
    assert_eq!(size("plain.png", png).0, [8, 4]);
}

#[test]
fn levels_in_the_upper_bits_of_a_word_are_moved_down() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("deep.png");
    let image = image::ImageBuffer::from_fn(16, 8, |x, y| Luma([(((x + 16 * y) * 31) << 4) as u16]));
    image.save(&path).unwrap();
    let footage = import::open(&[path], Some(1.0)).unwrap();
    assert!(footage.format == PixelFormat::Mono12 && footage.warnings[0].contains("lower 4 of 16 bits"));
    let pixels = footage.map(|frame| frame.unwrap().1).next().unwrap();
    assert_eq!(pixels, words(&(0..128).map(|k| k * 31).collect::<Vec<u16>>()));
}

#[test]
fn photron_colours_and_contradictions_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let open = |kind: &str, bits: &str, extra: &[(&str, &str)], pixels: Vec<u8>| {
        let entries = [
            ("Record Rate(fps)", "1000"),
            ("Total Frame", "1"),
            ("Image Width", "6"),
            ("Image Height", "4"),
            ("Color Type", kind),
            ("Color Bit", bits),
            ("EffectiveBit Depth", "8"),
            ("EffectiveBit Side", "Lower"),
        ];
        let entries: Vec<(&str, &str)> = extra.iter().copied().chain(entries).collect();
        fs::write(folder.path().join("a.mraw"), pixels).unwrap();
        let footage = import::open(&written(folder.path(), "a.cih", cih(&entries, " : ")), None).unwrap();
        let line = format!("{} {:?}", footage.summary(), footage.warnings);
        (line, footage.map(|frame| frame.unwrap().1).next().unwrap())
    };
    let mosaic: Vec<u8> = (0..24).map(|at| [[40, 100], [100, 200]][at / 6 % 2][at % 2]).collect();
    let (line, pixels) = open("Raw", "8", &[], mosaic);
    assert!(pixels == [110; 24] && line.contains("shows a mosaic") && line.contains("binomial"), "{line}");
    let (line, pixels) = open("Raw", "8", &[], vec![90; 24]);
    assert!(pixels == [90; 24] && line.contains("shows no mosaic"), "{line}");
    let (line, pixels) = open("Color", "24", &[], [50, 100, 200].repeat(24));
    assert!(pixels == [96; 24] && line.contains("BT.601"), "{line}");
    // 24 pixels at a step of 3 do not fit into a recording of one frame.
    let (line, _) = open("Mono", "8", &[("Save Step", "3"), ("Original Total Frame", "0")], vec![90; 24]);
    assert!(line.contains("1000 frames/s by the file's record rate") && line.contains("frame step of 3"), "{line}");
}
