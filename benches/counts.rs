//! Each kernel of a cycle once, on the demo's part at half resolution and one thread, for a program that counts instructions:
//! `benches/counts.py`. Prints what they gave. The frames are drawn into the folder that is given, or read where a first run has
//! drawn them: counting would make the drawing slow for nothing.

use anyhow::{Context, Result};
use bytemuck::Zeroable;
use files::config::Config;
use files::scene_file::parse_scene;
use fringe::cloud::Point;
use fringe::decode::{DecodeSettings, Decoder};
use fringe::frame::{FrameView, Pixels};
use fringe::fusion::{Fuser, FusionSettings};
use fringe::matching::{MatchSettings, Matcher};
use fringe::pattern::{Axis, frame_count};
use fringe::phase::PhaseMap;
use metrology::inspection::evaluate;
use std::path::{Path, PathBuf};
use twin::{PixelsMut, Twin, TwinSettings};

/// Columns and rows of the cameras.
const SIZE_PX: [u32; 2] = [562, 375];
const PIXELS: usize = (SIZE_PX[0] * SIZE_PX[1]) as usize;

/// A kernel that is counted: everything that happens inside of one of these functions.
type Kernel<'a> = &'a mut dyn FnMut() -> Result<()>;

/// Functions of these names, each with a body of its own, since equal ones would become one.
macro_rules! counted {
    ($($function:ident),*) => {$(
        #[inline(never)]
        fn $function(kernel: Kernel<'_>) -> Result<()> {
            std::hint::black_box(stringify!($function));
            kernel()
        }
    )*};
}
counted!(counted_decode, counted_match, counted_fuse, counted_inspect);

fn main() -> Result<()> {
    rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global()?;
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = PathBuf::from(std::env::args().nth(1).context("give a folder for the frames")?);
    let config = Config::load(&root.join("configs/demo.toml"))?;
    let scene = parse_scene(&config.twin.context("the demo has a twin")?.scene)?;
    let plan = config.cell.recipes.first().and_then(|recipe| recipe.plan.as_ref());
    let plan = plan.context("the demo has a plan")?;
    let rig = twin::thesis::rig(SIZE_PX[0], SIZE_PX[1]);
    let twin = Twin::new(&scene, TwinSettings::default(), &rig)?;
    let seen = |camera: &str, projector: &str| frames(&twin, camera, projector, &folder.join(camera));
    let mut clouds = Vec::new();
    for (number, pair) in rig.pairs.iter().enumerate() {
        let left = decoded(&seen(&pair.left, &pair.projector)?, number == 0)?;
        let right = decoded(&seen(&pair.right, &pair.projector)?, false)?;
        let [first, second] = [&pair.left, &pair.right].map(|name| rig.camera(name).context("a camera"));
        let mut matcher = Matcher::new(first?, second?, &MatchSettings::default())?;
        let mut points = vec![Point::zeroed(); matcher.capacity()];
        let mut count = 0;
        let mut run = || {
            count = matcher.run(&left.view(), &right.view(), number as u32, &mut points)?.points as usize;
            Ok(())
        };
        if number == 0 {
            counted_match(&mut run)?;
        } else {
            run()?;
        }
        points.truncate(count);
        clouds.push(points);
    }
    let slices: Vec<&[Point]> = clouds.iter().map(Vec::as_slice).collect();
    let mut fused = Vec::new();
    let mut fuser = Fuser::default();
    counted_fuse(&mut || {
        fuser.fuse(&slices, &FusionSettings::default(), &mut fused);
        Ok(())
    })?;
    let mut verdict = String::new();
    counted_inspect(&mut || {
        verdict = format!("{:?}", evaluate(plan, &fused).verdict);
        Ok(())
    })?;
    println!("{} points, verdict {verdict}", fused.len());
    Ok(())
}

/// The frames of a camera, one after another: read from a file, or drawn into it.
fn frames(twin: &Twin, camera: &str, projector: &str, file: &Path) -> Result<Vec<u8>> {
    if file.exists() {
        return Ok(std::fs::read(file)?);
    }
    let sequence = twin::thesis::sequence();
    let view = twin.view_lit_by(camera, &[projector], 0)?;
    let mut renderer = twin.renderer(projector, &sequence)?;
    let mut frames = vec![0; frame_count(&sequence) * PIXELS];
    for (frame, pixels) in frames.chunks_exact_mut(PIXELS).enumerate() {
        renderer.render(&view, frame, PixelsMut::Mono8(pixels))?;
    }
    std::fs::write(file, &frames)?;
    Ok(frames)
}

/// The phase of a camera.
fn decoded(frames: &[u8], count: bool) -> Result<PhaseMap> {
    let sequence = twin::thesis::sequence();
    let [width_px, height_px] = SIZE_PX;
    let settings = DecodeSettings::default();
    let mut decoder = Decoder::new(&sequence, width_px, height_px, 255, [608, 684], &settings)?;
    let mut map = PhaseMap::new(decoder.info(Axis::X)?);
    let mut run = || {
        for (number, frame) in frames.chunks_exact(PIXELS).enumerate() {
            let pixels = Pixels::Mono8(frame);
            decoder.push(number, &FrameView { width_px, height_px, full_scale_dn: 255, pixels })?;
        }
        decoder.finish(Axis::X, &mut map.view_mut())?;
        Ok(())
    };
    if count {
        counted_decode(&mut run)?;
    } else {
        run()?;
    }
    Ok(map)
}
