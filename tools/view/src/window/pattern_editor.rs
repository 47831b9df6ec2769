//! Editing a light's texture: the tools with their settings, and what they do.

use std::f32::consts::{PI, TAU};

use crate::mixer::LightMix;
use crate::pattern::{Brush, Pattern, Shape, ShapeKind};
use crate::sun::{Moment, PlacedSun};
use ltm::light::{Light, LightKind};

/// The tool of the pointer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Tool {
    Brush,
    Shape(ShapeKind),
    Turn,
    Sun,
}

/// The texture editor's settings, which outlive a change of light.
pub(super) struct PatternEditorState {
    pub(super) tool: Tool,
    pub(super) brush: Brush,
    /// Brightness of the paint, in stops.
    pub(super) paint_stops: f32,
    /// Size of shapes, as a fraction of the light's size.
    pub(super) shape_size: f32,
    last_touch: Option<[f32; 2]>,
    /// The handle of the light's shape that a drag moves.
    hold: Hold,
    /// The sun that is being put into a sky, and how far above the whole sky it is, in stops.
    pub(super) sun: Option<PlacedSun>,
    pub(super) sun_stops: f32,
    /// Time and place by which the sun is put.
    pub(super) moment: Moment,
}

/// The pointer over a light's texture, its button down.
#[derive(Clone, Copy)]
pub(super) struct Touch {
    /// In texels.
    pub(super) at: [f32; 2],
    /// By how much it turns an environment since the last frame.
    pub(super) moved_radians: f32,
    /// Where the button has just gone down: how near, in texels, is near enough to a shape's corner.
    pub(super) begins: Option<f32>,
}

/// Handles of a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Hold {
    /// At a place inside it, given from its middle, in fractions of the light's size.
    Inside([f32; 2]),
    /// At one of its corners.
    Corner,
}

impl Default for PatternEditorState {
    fn default() -> Self {
        Self {
            tool: Tool::Brush,
            brush: Brush { radius_texels: 2.0, hardness: 0.3, flow: 0.5, colour: [1.0; 3] },
            paint_stops: 2.0,
            shape_size: 0.5,
            last_touch: None,
            hold: Hold::Corner,
            sun: None,
            // Of a clear sky the sun sends some five times what the rest does.
            sun_stops: 2.3,
            moment: Moment::default(),
        }
    }
}

impl PatternEditorState {
    /// Whether the pointer places suns in skies.
    pub(super) fn puts_suns(&self) -> bool {
        self.tool == Tool::Sun
    }

    /// Puts the sun onto a texel of a sky.
    pub(super) fn put_sun(&mut self, own: &mut LightMix, index: usize, light: &Light, texel: usize) {
        self.sun = Some(PlacedSun::put(self.sun.take(), own, index, light, texel, self.sun_stops));
    }

    /// Ends a stroke of the brush.
    pub(super) fn lift(&mut self) {
        self.last_touch = None;
    }

    /// Uses the tool on a light.
    pub(super) fn use_tool(&mut self, own: &mut LightMix, index: usize, light: &Light, touch: Touch) {
        let (across, down) = light.layout();
        match self.tool {
            Tool::Sun => {
                let [x, y] = touch.at;
                let texel = [x.clamp(0.0, across as f32 - 1.0) as u32, y.clamp(0.0, down as f32 - 1.0) as u32];
                self.put_sun(own, index, light, (texel[1] * across + texel[0]) as usize);
            }
            Tool::Turn => {
                own.turn_radians = (own.turn_radians + touch.moved_radians + PI).rem_euclid(TAU) - PI;
                if own.pattern.is_none() {
                    own.pattern = Some(Pattern::white((across, down)));
                }
            }
            Tool::Brush => self.brush_at(own, light, touch.at),
            Tool::Shape(kind) => self.shape_at(own, light, kind, touch),
        }
    }

    fn brush_at(&mut self, own: &mut LightMix, light: &Light, at: [f32; 2]) {
        let mut pattern = own.pattern.take().unwrap_or_else(|| Pattern::white(light.layout()));
        // One paints on what one sees: a turned environment becomes its texture.
        if own.turn_radians != 0.0 {
            pattern = pattern.turned(light.kind, own.turn_radians).into_owned();
            own.turn_radians = 0.0;
        }
        let brush = Brush { colour: self.paint_colour(), ..self.brush };
        let wraps = matches!(light.kind, LightKind::LatLong { .. });
        match self.last_touch {
            Some(last) if last == at => {}
            Some(last) => pattern.stroke(&brush, last, at, wraps),
            None => pattern.touch(&brush, at, wraps),
        }
        self.last_touch = Some(at);
        put(own, pattern);
    }

    fn shape_at(&mut self, own: &mut LightMix, light: &Light, kind: ShapeKind, touch: Touch) {
        let (across, down) = light.layout();
        let at = [touch.at[0] / across as f32, touch.at[1] / down as f32];
        let mut shape = match own.shape {
            Some(shape) if shape.kind == kind => shape,
            _ => self.new_shape(kind, light, at),
        };
        if let Some(near) = touch.begins {
            let near = [near / across as f32, near / down as f32];
            let from_middle = [0, 1].map(|axis| at[axis] - shape.centre[axis]);
            let outside =
                |reach: f32| (0..2).any(|axis| from_middle[axis].abs() > shape.size[axis] / 2.0 + reach * near[axis]);
            let at_corner = (0..2).all(|axis| (from_middle[axis].abs() - shape.size[axis] / 2.0).abs() <= near[axis]);
            if !at_corner && outside(0.0) {
                shape = self.new_shape(kind, light, at);
            }
            self.hold = match at_corner {
                true => Hold::Corner,
                false => Hold::Inside([0, 1].map(|axis| at[axis] - shape.centre[axis])),
            };
        }
        match self.hold {
            Hold::Inside(offset) => shape.centre = [0, 1].map(|axis| at[axis] - offset[axis]),
            Hold::Corner => {
                shape.size = [0, 1].map(|axis| (2.0 * (at[axis] - shape.centre[axis]).abs()).clamp(0.01, 4.0));
            }
        }
        self.lay(own, light, shape);
    }

    fn paint_colour(&self) -> [f32; 3] {
        let gain = self.paint_stops.exp2();
        self.brush.colour.map(|v| v * gain)
    }

    /// A shape of the size that is set, which is in fractions of the light's smaller side, so that a disc is round.
    fn new_shape(&self, kind: ShapeKind, light: &Light, centre: [f32; 2]) -> Shape {
        let (across, down) = light.layout();
        let side = across.min(down) as f32 * self.shape_size;
        let size = [side / across as f32, side / down as f32];
        Shape { kind, centre, size, inside: self.paint_colour(), outside: [0.0; 3] }
    }

    /// Gives a light's shape the colour that is set, and the size if that was changed.
    pub(super) fn restyle(&mut self, own: &mut LightMix, light: &Light, resized: bool) {
        if let Some(shape) = own.shape {
            let new = self.new_shape(shape.kind, light, shape.centre);
            let size = if resized { new.size } else { shape.size };
            self.lay(own, light, Shape { size, ..new });
        }
    }

    /// Makes a light's shape larger or smaller, while shapes are the tool.
    pub(super) fn scale_shape(&mut self, own: &mut LightMix, light: &Light, factor: f32) {
        if let (Tool::Shape(_), Some(shape)) = (self.tool, own.shape) {
            let size = shape.size.map(|size| (size * factor).clamp(0.01, 4.0));
            self.lay(own, light, Shape { size, ..shape });
        }
    }

    /// Lays a shape over a light.
    fn lay(&mut self, own: &mut LightMix, light: &Light, shape: Shape) {
        let (across, down) = light.layout();
        // What is laid next, and the slider, follow what was drawn by hand.
        let sides = [shape.size[0] * across as f32, shape.size[1] * down as f32];
        self.shape_size = sides[0].max(sides[1]) / across.min(down) as f32;
        own.turn_radians = 0.0;
        (own.pattern, own.shape) = (Some(Pattern::of_shape(light.layout(), &shape)), Some(shape));
    }
}

/// Puts a pattern that no shape made on a light.
pub(super) fn put(own: &mut LightMix, pattern: Pattern) {
    (own.pattern, own.shape) = (Some(pattern), None);
}
