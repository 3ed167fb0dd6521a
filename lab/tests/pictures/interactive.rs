//! What an interactive window needs: frames that can be stopped, and asking an engine whether it
//! takes a scene.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering};

use rayo::internals::scene::many;
use rayo::{
    Camera, Cancel, Engine, EngineError, Film, FilmMut, Found, Frame, Light, PixelFormat, Plan, Precision, Purpose,
    RenderError, Scene, Settings, Tracer,
};

use crate::contenders::{Contender, contenders};

/// A tracer that is stopped while it traces the row `last`.
struct Stopped<'a> {
    cancel: &'a Cancel,
    last: u32,
    traced: AtomicU32,
}

impl Tracer for Stopped<'_> {
    fn writes(&self, _: PixelFormat) -> bool {
        true
    }
    fn rows(&self, rows: Range<u32>, _: FilmMut<'_>) {
        self.traced.fetch_add(rows.len() as u32, Ordering::Relaxed);
        if rows.contains(&self.last) {
            self.cancel.cancel();
        }
    }
    fn hits(&self, _: Range<u32>) -> Vec<Option<Found>> {
        Vec::new()
    }
}

#[test]
fn a_frame_that_is_stopped_traces_no_further_row_and_says_so() {
    let camera = Camera::new(4, 100, 1.0, 1.0).unwrap();
    let mut film = Film::new(PixelFormat::Bgra8, 400).unwrap();
    for last in [0, 7, 99] {
        let cancel = Cancel::default();
        let tracer = Stopped { cancel: &cancel, last, traced: AtomicU32::new(0) };
        let frame = Frame::new(&tracer, camera, Settings { threads: 1 }).unwrap().stopped_by(&cancel);
        let traced = frame.trace(0..100, film.as_mut(), &|_| {});
        assert!(matches!(traced, Err(RenderError::Cancelled)), "{traced:?}");
        assert_eq!(tracer.traced.load(Ordering::Relaxed), last + 1);
    }
}

#[test]
fn a_file_whose_picture_is_stopped_is_not_written() {
    let (camera, cancel) = (Camera::new(4, 100, 1.0, 1.0).unwrap(), Cancel::default());
    let tracer = Stopped { cancel: &cancel, last: 7, traced: AtomicU32::new(0) };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stopped.png");
    let frame = Frame::new(&tracer, camera, Settings { threads: 1 }).unwrap().stopped_by(&cancel);
    let mut image = rayo::ImageWriter::create(&path, rayo::Format::Png, 4, 100).unwrap();
    let written = rayo::render_to_file(&frame, &mut image, &|_| {});
    assert!(matches!(written, Err(RenderError::Cancelled)), "{written:?}");
    drop(image);
    assert!(!path.exists());
}

/// A contender's plan of a scene, with a `Cancel` that may stop it.
fn plan<'a>(contender: &Contender, scene: &'a Scene, cancel: Option<&Cancel>) -> Result<Plan<'a>, EngineError> {
    let purpose = Purpose { precision: Some(contender.precision), threads: 2, cancel, ..Purpose::default() };
    Plan::new(contender.engine, scene, purpose)
}

#[test]
fn cancelled_plan_is_an_error_and_leaves_no_trace() {
    let [stopped, going] = [Cancel::default(), Cancel::default()];
    stopped.cancel();
    let plain = Scene { camera: Camera::new(40, 30, 1.0, 1.0).unwrap(), ..many(20, 2_000, 3) };
    for contender in contenders() {
        let scene = Scene { shadows: contender.engine.has_shadows(), ..plain.clone() };
        // Engines that trace single rays would take too long with all objects.
        let scene = if contender.engine.is_packet() { scene } else { Scene { triangles: Vec::new(), ..scene } };
        assert_eq!(plan(&contender, &scene, Some(&stopped)).err(), Some(EngineError::Cancelled), "{contender}");
        let [may_be_stopped, other] = [Some(&going), None].map(|cancel| {
            let plan = plan(&contender, &scene, cancel).unwrap();
            let mut film = Film::new(PixelFormat::Rgba8, 40 * 30).unwrap();
            let frame = Frame::new(plan.tracer(), scene.camera, Settings { threads: 2 }).unwrap();
            let frame = if let Some(cancel) = cancel { frame.stopped_by(cancel) } else { frame };
            frame.trace(0..30, film.as_mut(), &|_| {}).unwrap();
            film
        });
        assert!(may_be_stopped == other, "{contender}");
    }
}

#[test]
fn an_engine_tells_what_it_does_not_take_as_its_plan_would() {
    let dark = Light { intensity: 0.0, ..many(0, 0, 1).lights[0] };
    let bright = Light { intensity: 1.0, ..dark };
    let plain = Scene { camera: Camera::new(4, 3, 1.0, 1.0).unwrap(), ..many(2, 2, 1) };
    let most = 1 << 18;
    let scenes = [
        Scene { shadows: true, ..plain.clone() },
        Scene { lights: vec![dark; most + 1], ..plain.clone() },
        Scene { lights: vec![bright; most + 1], ..plain.clone() },
        plain,
    ];
    let precisions = [Precision::Single, Precision::Fast, Precision::Double].map(Some);
    let mut refused = 0;
    for (engine, scene) in Engine::ALL.iter().flat_map(|engine| scenes.iter().map(move |scene| (*engine, scene))) {
        for precision in precisions.into_iter().chain([None]) {
            let told = engine.takes(scene, precision).err();
            let met = Plan::new(engine, scene, Purpose { precision, ..Purpose::default() }).err();
            assert_eq!(told, met, "{engine} in {precision:?}");
            refused += usize::from(told.is_some());
        }
    }
    assert!(refused > 2 * Engine::ALL.len(), "{refused}");
}
