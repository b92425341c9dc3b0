//! Files of cameras and sequences of images.

use super::ball::{self, Ball, RIG, analyze, refusal};
use crate::import::encoders::{Cine, Field, TiffPage, cih, tiff_file};
use crate::import::pages::Kind;
use image::{GrayImage, ImageBuffer, Luma};
use ricochet::import;
use std::fs;
use std::path::PathBuf;

/// The right value of most reports.
const TRUTH: [f64; 3] = [2.0, -0.75, 43.63];

/// The folder of a report, if the real data were named.
fn report(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("RICOCHET_REAL_DATA").map(PathBuf::from);
    if folder.is_none() {
        eprintln!("left out: RICOCHET_REAL_DATA does not name the folder of real recordings");
    }
    folder.map(|folder| folder.join("field").join(name))
}

/// Measures a report as its README does.
fn of_report(name: &str, arguments: &str) -> Option<ball::Measured> {
    let folder = report(name)?;
    Some(analyze(&folder, &folder.join("rig.toml"), arguments))
}

/// A folder with the rig file of the variants.
struct Variant(tempfile::TempDir);

impl Variant {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("rig.toml"), RIG).unwrap();
        Self(folder)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, bytes).unwrap();
        path
    }

    fn measure(&self, arguments: &str) -> ball::Measured {
        analyze(self.0.path(), &self.path("rig.toml"), arguments)
    }

    fn write_stills(&self, size: [u32; 2], frames: &[Vec<u8>], name: impl Fn(usize) -> String) {
        for (index, frame) in frames.iter().enumerate() {
            let image = GrayImage::from_raw(size[0], size[1], frame.clone()).unwrap();
            image.save(self.path(&name(index))).unwrap();
        }
    }
}

/// Rows bottom first, as a Windows bitmap has them.
fn bottom_up(frames: &[Vec<u8>], row_bytes: usize) -> Vec<Vec<u8>> {
    frames.iter().map(|frame| frame.chunks(row_bytes).rev().flatten().copied().collect()).collect()
}

fn cine_of(ball: &Ball, frames: &[Vec<u8>]) -> Cine {
    let [width, height] = ball.size;
    Cine::new([width as i32, height as i32], ball.rate_hz as u32, bottom_up(frames, width as usize))
}

#[test]
fn cine_decimated_rate() {
    if let Some(folder) = report("cine-decimated-rate") {
        let mut footage = import::open(&[folder.join("bubble.cine")], None).unwrap();
        let hz = footage.frame_rate_hz;
        assert!((hz - 9003.2).abs() < 1.0, "{hz}");
        let line = format!("{} {:?}", footage.summary(), footage.warnings);
        assert!(
            line.contains("90000") && line.contains("9003.") && line.contains("by the times of the frames"),
            "{line}"
        );
        // The trigger lies 0.601673 s behind the first image.
        let trigger_ns = 1_551_223_046_525_629_000_f64;
        let first_ns = footage.next().unwrap().unwrap().0.stamp_ns as f64;
        assert!(((trigger_ns - first_ns) * 1e-9 - 0.601_673).abs() < 1e-4, "{first_ns}");
    }
    // One image of 4 and one of 25 was saved; the header keeps the rate of the camera.
    for step in [4_u32, 25] {
        let folder = Variant::new();
        let ball = Ball { size: [132, 120], rate_hz: 6000.0, ..Ball::REPORTED };
        let frames = ball.frames(0..24);
        let times = (0..24).map(|k| f64::from(k) / ball.rate_hz - 0.3).collect();
        let rate_hz = 6000 * step;
        folder.write("thin.cine", Cine { rate_hz, times_s: Some(times), ..cine_of(&ball, &frames) }.bytes());
        let measured = folder.measure("thin.cine");
        measured.check([2.0, -0.75, 43.63], 24, 0);
        measured.says(&[&format!("FrameRate says {rate_hz}"), "by the times of the frames"]);
    }
}

#[test]
fn cine_missing_images() {
    if let Some(measured) = of_report("cine-missing-images", "gap.cine") {
        measured.check(TRUTH, 33, 3);
        measured.says(&["3 frames missing in 1 place"]);
    }
    for (lost, ball) in [
        (vec![8, 9], Ball { vx: 1.1, vy: 0.4, omega: -30.0, start: [50.0, 60.0], ..Ball::REPORTED }),
        (vec![5, 17, 18, 19, 20], Ball { rate_hz: 3000.0, ..Ball::REPORTED }),
    ] {
        let folder = Variant::new();
        let kept: Vec<u32> = (0..26).filter(|number| !lost.contains(number)).collect();
        let times = kept.iter().map(|k| f64::from(*k) / ball.rate_hz - 0.002).collect();
        let frames = ball.frames(kept.iter().copied());
        folder.write("gap.cine", Cine { times_s: Some(times), ..cine_of(&ball, &frames) }.bytes());
        let measured = folder.measure("gap.cine");
        measured.check([ball.vx, ball.vy, ball.omega], kept.len(), lost.len());
        measured.says(&[&format!("{} frames missing", lost.len())]);
    }
}

#[test]
fn cine_flip_flag() {
    if let Some(measured) = of_report("cine-flip-flag", "flip.cine") {
        measured.check([-2.0, -0.75, -43.63], 36, 0);
        measured.says(&["mirrored"]);
    }
    let (flip_h, flip_v, rotate) = (756, 760, 884);
    let ball = Ball { start: [50.0, 50.0], ..Ball::REPORTED };
    for (setup, truth, words) in [
        (vec![(flip_v, 1)], [2.0, 0.75, -43.63], "flipped upside down"),
        (vec![(flip_h, 1), (flip_v, 1)], [-2.0, 0.75, 43.63], "turned by 180 deg"),
        (vec![(rotate, 90)], [0.75, 2.0, 43.63], "turned by 90 deg counter-clockwise"),
        (vec![(rotate, -90_i32 as u32)], [-0.75, -2.0, 43.63], "turned by 90 deg clockwise"),
    ] {
        let folder = Variant::new();
        let frames = ball.frames(0..24);
        folder.write("flip.cine", Cine { setup, ..cine_of(&ball, &frames) }.bytes());
        let measured = folder.measure("flip.cine");
        measured.check(truth, 24, 0);
        measured.says(&[words]);
    }
}

#[test]
fn cih_8_bits_of_12() {
    if let Some(measured) = of_report("cih-8-bits-of-12", "pdc.cih") {
        measured.check(TRUTH, 36, 0);
        measured.says(&["8 of 12 bits"]);
    }
    let ball = Ball { size: [128, 128], rate_hz: 4000.0, ..Ball::REPORTED };
    let entries = |bits: &'static str, depth: &'static str, side: &'static str| {
        [
            ("Camera Type", "FASTCAM"),
            ("Record Rate(fps)", "4000"),
            ("Total Frame", "20"),
            ("Image Width", "128"),
            ("Image Height", "128"),
            ("Color Type", "Raw"),
            ("Color Bit", bits),
            ("EffectiveBit Depth", depth),
            ("EffectiveBit Side", side),
        ]
    };
    // 8 of 10 bits without spaces, and 12 bits at the upper end.
    let folder = Variant::new();
    folder.write("a.cih", cih(&entries("8", "10", "Lower"), " :"));
    folder.write("a.mraw", ball.frames(0..20).concat());
    let measured = folder.measure("a.cih");
    measured.check(TRUTH, 20, 0);
    measured.says(&["8 of 10 bits", "no mosaic"]);
    folder.write("b.cih", [&b"\xef\xbb\xbf"[..], cih(&entries("16", "12", "Higher"), ":").as_bytes()].concat());
    let words = ball.deep_frames(0..20, 12).concat();
    let upper: Vec<u8> =
        words.chunks(2).flat_map(|pair| (u16::from_le_bytes([pair[0], pair[1]]) << 4).to_le_bytes()).collect();
    folder.write("b.mraw", upper);
    let measured = folder.measure("b.mraw");
    measured.check(TRUTH, 20, 0);
    measured.says(&["12 bit grey"]);
}

#[test]
fn cih_save_step() {
    if let Some(measured) = of_report("cih-save-step", "thin.cih") {
        measured.check(TRUTH, 18, 0);
        measured.says(&["2500", "5000"]);
    }
    for (step, recorded, key) in [("3", "66", "Save Step"), ("5", "200", "skipFrame")] {
        let folder = Variant::new();
        let ball = Ball { rate_hz: 4500.0, ..Ball::REPORTED };
        let recorded_hz = (4500 * step.parse::<u32>().unwrap()).to_string();
        let entries = [
            ("Record Rate(fps)", recorded_hz.as_str()),
            ("Original Total Frame", recorded),
            ("Total Frame", "22"),
            (key, step),
            ("Image Width", "144"),
            ("Image Height", "112"),
            ("Color Type", "Mono"),
            ("Color Bit", "8"),
            ("EffectiveBit Depth", "8"),
            ("EffectiveBit Side", "Lower"),
        ];
        folder.write("thin.cih", cih(&entries, " : "));
        folder.write("thin.mraw", ball.frames(0..22).concat());
        let measured = folder.measure("thin.cih");
        measured.check(TRUTH, 22, 0);
        measured.says(&["4500", &recorded_hz]);
    }
}

#[test]
fn tiff_imagej_one_directory() {
    if let Some(measured) = of_report("tiff-imagej-one-directory", "stack.tif --fps 5000") {
        measured.check(TRUTH, 36, 0);
    }
    let ball = Ball { rate_hz: 4000.0, size: [140, 118], ..Ball::REPORTED };
    for (kind, bits) in [(Kind::Big, 16), (Kind::Little, 8)] {
        let folder = Variant::new();
        let mut pixels = if bits == 8 { ball.frames(0..20).concat() } else { ball.deep_frames(0..20, 12).concat() };
        if kind == Kind::Big {
            pixels.chunks_exact_mut(2).for_each(<[u8]>::reverse);
        }
        let text = "ImageJ=1.53t\nimages=20\nslices=20\nfinterval=0.25\ntunit=ms\nfps=7.0\n".to_owned();
        let page = TiffPage::new(ball.size, bits, pixels, &[(270, Field::Text(text))]);
        folder.write("stack.tif", tiff_file(kind, &[page]));
        let measured = folder.measure("stack.tif");
        measured.check(TRUTH, 20, 0);
        measured.says(&["20 frames", "4000 frames/s by the file's finterval"]);
    }
    // Images that are announced but not there are missed.
    let folder = Variant::new();
    let text = "ImageJ=1.53t\nimages=20\n".to_owned();
    let page = TiffPage::new(ball.size, 8, ball.frames(0..1).concat(), &[(270, Field::Text(text))]);
    let path = folder.write("short.tif", tiff_file(Kind::Little, &[page]));
    let output = folder.path("out.mcap");
    let line = refusal(&["import", path.to_str().unwrap(), "--fps", "1", "-o", output.to_str().unwrap()]);
    assert!(line.contains("20 images are announced"), "{line}");
}

#[test]
fn sequence_negative_numbers() {
    if let Some(measured) = of_report("sequence-negative-numbers", "img/*.png --fps 5000") {
        measured.check(TRUTH, 36, 0);
    }
    let ball = Ball { size: [128, 112], ..Ball::REPORTED };
    let frames = ball.frames(0..24);
    for (name, arguments) in [
        ((|k: i32| format!("t{k:+05}.png")) as fn(i32) -> String, "*.png --fps 5000"),
        (|k: i32| if k < 0 { format!("s_-{}.png", -k) } else { format!("s_{k}.png") }, "'s_*.png' --fps 5000"),
    ] {
        let folder = Variant::new();
        folder.write_stills(ball.size, &frames, |index| name(index as i32 - 9));
        folder.measure(arguments).check(TRUTH, 24, 0);
    }
}

#[test]
fn sequence_suffix_number() {
    if let Some(measured) = of_report("sequence-suffix-number", "img/*.png --fps 5000") {
        measured.check(TRUTH, 36, 0);
    }
    let ball = Ball::REPORTED;
    let frames = ball.frames(0..22);
    let folder = Variant::new();
    folder.write_stills(ball.size, &frames, |index| format!("frame_{index}_of_22.png"));
    folder.measure("*.png --fps 5000").check(TRUTH, 22, 0);
    // The numbers of a folder, and times in microseconds.
    let folder = Variant::new();
    fs::create_dir(folder.path("shot")).unwrap();
    folder.write_stills(ball.size, &frames, |index| format!("shot/c1_{}us_left.png", 1_000_000 + 200 * index));
    let measured = folder.measure("shot");
    measured.check(TRUTH, 22, 0);
    measured.says(&["5000 frames/s by the times of the frames"]);
    // Two series in one folder leave the order open.
    let folder = Variant::new();
    folder.write_stills(ball.size, &frames[..6], |index| format!("run{}_{}.png", index / 3, index % 3));
    let input = folder.0.path().to_str().unwrap();
    let rig = folder.path("rig.toml");
    let line = refusal(&["analyze", input, "--fps", "5000", "--config", rig.to_str().unwrap()]);
    assert!(line.contains("\"run\" (0 to 1)") && line.contains("\"_\" (0 to 2)"), "{line}");
}

#[test]
fn jpeg_sequence() {
    if let Some(folder) = report("jpeg-sequence") {
        let measured = analyze(&folder, &folder.join("rig.toml"), "img/*.jpg --fps 5000");
        measured.says(&["JPEG is lossy"]);
        measured.check(TRUTH, 6, 0);
    }
    let ball = Ball::REPORTED;
    let folder = Variant::new();
    for (index, frame) in ball.frames(0..20).into_iter().enumerate() {
        let image = GrayImage::from_raw(144, 112, frame).unwrap();
        image.save(folder.path(&format!("g{index}.jpeg"))).unwrap();
        // The same in colour: red, green and blue that have this luma.
        let colored = |pixel: &Luma<u8>| image::Rgb([pixel.0[0], pixel.0[0], pixel.0[0] / 2]);
        let colored = ImageBuffer::from_fn(144, 112, |x, y| colored(image.get_pixel(x, y)));
        colored.save(folder.path(&format!("c{index}.jpg"))).unwrap();
    }
    folder.measure("'g*.jpeg' --fps 5000").check(TRUTH, 20, 0);
    let measured = folder.measure("'c*.jpg' --fps 5000");
    measured.check(TRUTH, 20, 0);
    measured.says(&["grey from colour by ITU-R BT.601"]);
    let (rig, folder) = (folder.path("rig.toml"), folder.0.path().to_str().unwrap().to_owned());
    let line = refusal(&["analyze", &folder, "--fps", "5000", "--config", rig.to_str().unwrap()]);
    assert!(line.contains("no number in common"), "{line}");
}
