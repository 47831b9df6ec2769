//! Lights in the picture, where the container says how its camera stood: suns that are dragged, and a band that selects.

use eframe::egui::{self, Color32, Pos2, Rect, Stroke};

use super::light_list::LightList;
use super::open_view::OpenView;
use super::pattern_editor::PatternEditorState;
use super::theme::ACCENT;
use crate::mixer::Mix;
use crate::seen::{lights_within, position};
use crate::sun::{PlacedSun, choose_sun, suns};
use crate::worker::Session;
use ltm::light::{LightBasis, LightKind};
use ltm::scene::Camera;

/// How near, in points, the pointer must be to take hold of a sun.
pub(super) const SUN_GRIP: f32 = 12.0;

/// A sun in the picture.
pub(super) struct SeenSun {
    /// The sky that it stands in, or the light that it is.
    pub(super) light: usize,
    /// Position in pixels from the image's top left.
    pub(super) position: [f32; 2],
    shines: bool,
}

/// The camera that the picture was rendered with.
fn camera(session: &Session) -> Option<Camera> {
    Camera::of_job(session.container.job())
}

/// Whether places of the picture say directions: not without a camera, nor with an orthographic one, of which all have the same.
pub(super) fn shows_directions(session: &Session) -> bool {
    camera(session).is_some_and(|camera| !camera.is_orthographic())
}

/// The suns that the camera has before it: that which was `placed` into a sky, and those of the scene.
pub(super) fn seen_suns(view: &OpenView, mix: &Mix, placed: Option<&PlacedSun>) -> Vec<SeenSun> {
    let Some(camera) = camera(&view.session) else { return Vec::new() };
    let (basis, places) = (view.session.basis(), view.lights.places());
    let placed = placed.and_then(|sun| {
        let (index, own) = (sun.light(), mix.lights.get(sun.light())?);
        // A sky that is turned takes its sun along; the next sun is put into the sky as it lies then.
        let texel = sun.texel(index, own).filter(|_| own.turn_radians == 0.0)?;
        let direction = basis.lights()[view.lights.own(index)?].places[texel];
        Some((index, camera.position(direction.into())?.to_array()))
    });
    let own = suns(basis).into_iter();
    let own = own.filter_map(|index| Some((places[index], position(&camera, &basis.lights()[index])?)));
    placed
        .into_iter()
        .chain(own)
        .map(|(light, position)| SeenSun { light, position, shines: mix.shines(light) })
        .collect()
}

/// Moves the sun of a sky to where a position of the picture points, or leaves on that of several suns which stands
/// nearest to it; `all`: the lights of all views.
pub(super) fn move_sun(
    view: &OpenView,
    all: &LightBasis,
    mix: &mut Mix,
    editor: &mut PatternEditorState,
    (light, position): (usize, [f32; 2]),
) {
    let Some(camera) = camera(&view.session) else { return };
    let direction = camera.direction(position.into()).to_array();
    let own = &all.lights()[light];
    if own.kind == LightKind::Sun {
        choose_sun(all, mix, direction);
    } else {
        editor.put_sun(&mut mix.lights[light], light, own, own.nearest_texel(direction));
    }
}

/// Selects the lights whose middle lies where the picture `holds` them, beside those that are selected if it `adds`; what
/// to say about it.
pub(super) fn select_in_picture(
    view: &OpenView,
    list: &mut LightList,
    holds: impl Fn([f32; 2]) -> bool,
    adds: bool,
) -> String {
    let Some(camera) = camera(&view.session) else {
        return "This container does not say how its camera stood; those rendered from now on do".to_owned();
    };
    let found = lights_within(&camera, view.session.basis(), holds).into_iter();
    let found: Vec<usize> = found.map(|light| view.lights.places()[light]).collect();
    let count = found.len();
    if count > 0 {
        let before: Vec<usize> = list.chosen().iter().copied().filter(|_| adds).collect();
        list.select_all(found.into_iter().chain(before));
        list.scroll_to_selected = true;
    }
    match count {
        0 => "No light has its middle there".to_owned(),
        1 => "One light selected".to_owned(),
        count => format!("{count} lights selected"),
    }
}

/// Draws the suns over the picture. `to_screen` brings picture positions there.
pub(super) fn draw_suns(painter: &egui::Painter, suns: &[SeenSun], to_screen: impl Fn([f32; 2]) -> Option<Pos2>) {
    for sun in suns {
        let Some(at) = to_screen(sun.position) else { continue };
        let colour = if sun.shines { Color32::from_rgb(255, 214, 90) } else { Color32::from_gray(150) };
        for (width, colour) in [(4.0, Color32::from_black_alpha(170)), (1.8, colour)] {
            let stroke = Stroke::new(width, colour);
            painter.circle_stroke(at, 5.0, stroke);
            for ray in 0..8 {
                let direction = egui::Vec2::angled(ray as f32 * std::f32::consts::FRAC_PI_4);
                painter.line_segment([at + direction * 8.0, at + direction * 11.5], stroke);
            }
        }
    }
}

/// Draws the band that selects.
pub(super) fn draw_band(painter: &egui::Painter, band: Rect) {
    painter.rect_filled(band, 0.0, ACCENT.gamma_multiply(0.15));
    painter.rect_stroke(band, 0.0, (1.0, ACCENT), egui::StrokeKind::Middle);
}
