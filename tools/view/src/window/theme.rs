//! Colours and spacing: dark, calm, neutral around the picture.

use eframe::egui::{self, Color32, CornerRadius, FontFamily, FontId, Stroke, TextStyle};

use ltm::image::encode_srgb;

/// Behind the picture: a neutral grey, so that no colour is judged against another.
pub(super) const SURROUND: Color32 = Color32::from_gray(18);
/// Panels.
pub(super) const PANEL: Color32 = Color32::from_gray(27);
/// Lines between them.
pub(super) const LINE: Color32 = Color32::from_gray(44);
/// Troughs of faders and bars.
pub(super) const TROUGH: Color32 = Color32::from_gray(108);
/// Ordinary text.
pub(super) const TEXT: Color32 = Color32::from_gray(208);
/// Text of less weight.
pub(super) const WEAK: Color32 = Color32::from_gray(152);
/// Signs of controls that are not in use.
pub(super) const IDLE: Color32 = Color32::from_gray(130);
/// Behind selected rows.
pub(super) const SELECTED: Color32 = Color32::from_rgb(52, 44, 34);
/// Colour of selected and active parts.
pub(super) const ACCENT: Color32 = Color32::from_rgb(232, 168, 76);
/// Colour of errors.
pub(super) const ALARM: Color32 = Color32::from_rgb(236, 110, 92);

/// Gives all of a context's widgets these colours.
pub(super) fn apply(context: &egui::Context) {
    context.set_theme(egui::Theme::Dark);
    // Ctrl+0 is the picture's.
    context.options_mut(|options| options.zoom_with_keyboard = false);
    context.all_styles_mut(|style| {
        style.text_styles = [
            (TextStyle::Heading, FontId::new(15.0, FontFamily::Proportional)),
            (TextStyle::Body, FontId::new(13.0, FontFamily::Proportional)),
            (TextStyle::Button, FontId::new(13.0, FontFamily::Proportional)),
            (TextStyle::Small, FontId::new(11.0, FontFamily::Proportional)),
            (TextStyle::Monospace, FontId::new(12.0, FontFamily::Monospace)),
        ]
        .into();
        style.spacing.item_spacing = egui::vec2(8.0, 6.0);
        style.spacing.button_padding = egui::vec2(8.0, 3.0);
        style.spacing.slider_width = 150.0;
        style.spacing.interact_size.y = 22.0;
        let visuals = &mut style.visuals;
        visuals.panel_fill = PANEL;
        visuals.window_fill = Color32::from_gray(32);
        visuals.window_stroke = Stroke::new(1.0, LINE);
        visuals.extreme_bg_color = Color32::from_gray(17);
        visuals.selection.bg_fill = Color32::from_rgb(104, 78, 42);
        visuals.selection.stroke = Stroke::new(1.0, Color32::from_rgb(250, 214, 160));
        visuals.slider_trailing_fill = true;
        visuals.widgets.noninteractive.bg_stroke = Stroke::new(1.0, LINE);
        visuals.widgets.noninteractive.fg_stroke = Stroke::new(1.0, TEXT);
        visuals.widgets.inactive.weak_bg_fill = Color32::from_gray(44);
        visuals.widgets.inactive.bg_fill = Color32::from_gray(50);
        visuals.widgets.inactive.fg_stroke = Stroke::new(1.0, TEXT);
        visuals.widgets.hovered.weak_bg_fill = Color32::from_gray(56);
        visuals.widgets.hovered.bg_stroke = Stroke::new(1.0, Color32::from_gray(92));
        visuals.widgets.active.bg_stroke = Stroke::new(1.0, ACCENT);
        let rounded = CornerRadius::same(4);
        for widget in [
            &mut visuals.widgets.noninteractive,
            &mut visuals.widgets.inactive,
            &mut visuals.widgets.hovered,
            &mut visuals.widgets.active,
            &mut visuals.widgets.open,
        ] {
            widget.corner_radius = rounded;
        }
    });
}

/// A linear colour on the screen, its largest channel brought to white.
pub(super) fn swatch(colour: [f32; 3]) -> Color32 {
    let peak = colour.into_iter().fold(1e-9, f32::max);
    let [r, g, b] = colour.map(|v| (encode_srgb(v / peak) * 255.0 + 0.5) as u8);
    Color32::from_rgb(r, g, b)
}

/// A small heading over a part of a panel.
pub(super) fn section(ui: &mut egui::Ui, title: &str) {
    ui.add_space(10.0);
    ui.label(egui::RichText::new(title).size(11.0).color(WEAK).strong());
    ui.add_space(1.0);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Contrast of two colours (WCAG 2.2, section 1.4.3).
    fn contrast(a: Color32, b: Color32) -> f32 {
        let light = |colour: Color32| {
            let [r, g, b, _] = colour.to_array().map(|v| ltm::image::decode_srgb(f32::from(v) / 255.0));
            ltm::image::luminance([r, g, b]) + 0.05
        };
        let (a, b) = (light(a), light(b));
        a.max(b) / a.min(b)
    }

    #[test]
    fn text_stands_out_by_four_and_a_half_and_controls_by_three() {
        let context = egui::Context::default();
        apply(&context);
        let visuals = &context.global_style().visuals.clone();
        let widgets = &visuals.widgets;
        let grounds =
            [PANEL, SURROUND, SELECTED, visuals.window_fill, visuals.extreme_bg_color, widgets.inactive.weak_bg_fill];
        for ground in grounds {
            for text in [TEXT, WEAK, ACCENT, ALARM] {
                assert!(contrast(text, ground) >= 4.5, "{text:?} on {ground:?}: {}", contrast(text, ground));
            }
        }
        for (name, text, ground) in [
            ("a button", widgets.inactive.fg_stroke.color, widgets.inactive.weak_bg_fill),
            ("a button under the pointer", widgets.hovered.fg_stroke.color, widgets.hovered.weak_bg_fill),
            ("a button that is pressed", widgets.active.fg_stroke.color, widgets.active.weak_bg_fill),
            ("an open menu", widgets.open.fg_stroke.color, widgets.open.weak_bg_fill),
            ("what is selected", visuals.selection.stroke.color, visuals.selection.bg_fill),
        ] {
            assert!(contrast(text, ground) >= 4.5, "{name}: {}", contrast(text, ground));
        }
        for (name, control, ground) in [
            ("a sign that is not in use", IDLE, PANEL),
            ("the same in a selected row", IDLE, SELECTED),
            ("a fader's trough", TROUGH, PANEL),
            ("what is alive", ACCENT, PANEL),
        ] {
            assert!(contrast(control, ground) >= 3.0, "{name}: {}", contrast(control, ground));
        }
        assert!((contrast(Color32::BLACK, Color32::WHITE) - 21.0).abs() < 1e-3);
    }
}
