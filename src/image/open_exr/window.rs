//! Windows of pixels in the camera's frame.

use std::fmt;

use exr::meta::header::Header;

/// A rectangle of pixels; x runs to the right, y downwards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::image) struct Window {
    pub(in crate::image) x: i64,
    pub(in crate::image) y: i64,
    pub(in crate::image) width: u64,
    pub(in crate::image) height: u64,
}

/// The data window of a part, where its pixels lie, and the display window, which is the picture's frame. A frame without
/// pixels is none: then the data are the picture.
pub(in crate::image) fn windows_of(header: &Header) -> (Window, Window) {
    let (corner, size) = (header.own_attributes.layer_position, header.layer_size);
    let data =
        Window { x: corner.0.into(), y: corner.1.into(), width: size.width() as u64, height: size.height() as u64 };
    let frame = header.shared_attributes.display_window;
    let (corner, size) = (frame.position, frame.size);
    let display =
        Window { x: corner.0.into(), y: corner.1.into(), width: size.width() as u64, height: size.height() as u64 };
    (data, if display.width == 0 || display.height == 0 { data } else { display })
}

/// The frame of images that must have one size: their common pixels if all have the same, otherwise the whole frame
/// with everything beyond.
///
/// # Errors
/// The first image whose picture has another frame than the first.
pub(in crate::image) fn common_frame(windows: &[(Window, Window)]) -> Result<Window, usize> {
    let Some(&(data, display)) = windows.first() else { return Ok(Window::of_size(0, 0)) };
    if let Some(other) = windows.iter().position(|(_, other)| *other != display) {
        return Err(other);
    }
    let is_one = windows.iter().all(|(other, _)| *other == data);
    Ok(if is_one { data } else { windows.iter().fold(display, |frame, (data, _)| frame.around(data)) })
}

/// What a frame is, where it is not the picture that the images were rendered for.
pub(in crate::image) fn note_of_frame(frame: &Window, windows: &[(Window, Window)]) -> Option<String> {
    let display = windows.first()?.1;
    let placed = windows.iter().filter(|(data, _)| data != frame).count();
    let what = if display.holds(frame) { "a part" } else { "with what lies beyond the edges" };
    match (placed, *frame == display) {
        (0, true) => None,
        (0, false) => Some(format!("the images are {frame} of a picture of {display}, {what}")),
        (placed, true) => Some(format!(
            "{placed} images were cropped to a part of the picture; they are put back in their places, black around"
        )),
        (placed, false) => Some(format!(
            "{placed} images cover different parts of {display}; they are put in their places in {frame}, black around"
        )),
    }
}

impl Window {
    /// A whole picture that lies at its own origin.
    pub(in crate::image) fn of_size(width: u32, height: u32) -> Self {
        Self { x: 0, y: 0, width: width.into(), height: height.into() }
    }

    /// Its size, for messages.
    pub(in crate::image) fn size(&self) -> String {
        format!("{} × {} pixels", self.width, self.height)
    }

    fn right(&self) -> i64 {
        self.x + self.width as i64
    }

    fn bottom(&self) -> i64 {
        self.y + self.height as i64
    }

    /// The smallest window around both.
    pub(in crate::image) fn around(&self, other: &Self) -> Self {
        let (x, y) = (self.x.min(other.x), self.y.min(other.y));
        let (right, bottom) = (self.right().max(other.right()), self.bottom().max(other.bottom()));
        Self { x, y, width: (right - x) as u64, height: (bottom - y) as u64 }
    }

    /// Whether it contains all of `other`.
    pub(in crate::image) fn holds(&self, other: &Self) -> bool {
        self.around(other) == *self
    }

    /// Whether the two overlap.
    pub(in crate::image) fn meets(&self, other: &Self) -> bool {
        self.x < other.right() && other.x < self.right() && self.y < other.bottom() && other.y < self.bottom()
    }

    /// Whether the pixel at `(x, y)` of `frame` lies in this window.
    pub(in crate::image) fn covers(&self, frame: &Self, (x, y): (usize, usize)) -> bool {
        let (x, y) = (frame.x + x as i64, frame.y + y as i64);
        (self.x..self.right()).contains(&x) && (self.y..self.bottom()).contains(&y)
    }

    /// For a run of `length` pixels of this window from `(x, y)` on: how many lie before `frame`, and the position in
    /// `frame` and the length of those inside. `None` if there are none inside.
    pub(in crate::image) fn clip(&self, frame: &Self, (x, y): (usize, usize), length: usize) -> Option<Clipped> {
        let (x, y) = (self.x + x as i64 - frame.x, self.y + y as i64 - frame.y);
        let skipped = (-x).max(0);
        let end = (x + length as i64).min(frame.width as i64);
        let first = x + skipped;
        let is_inside = (0..frame.height as i64).contains(&y) && first < end;
        is_inside.then(|| Clipped {
            skipped: skipped as usize,
            x: first as usize,
            y: y as usize,
            length: (end - first) as usize,
        })
    }

    /// The runs of `frame` outside this window, `(x, y, length)`: no pixel twice.
    pub(in crate::image) fn outside(&self, frame: &Self) -> impl Iterator<Item = (usize, usize, usize)> {
        let (left, right) = (self.x - frame.x, self.right() - frame.x);
        let rows = self.y - frame.y..self.bottom() - frame.y;
        let width = frame.width as i64;
        let (left, right) = (left.clamp(0, width), right.clamp(0, width));
        (0..frame.height as i64).flat_map(move |y| {
            let runs = if rows.contains(&y) { [(0, left), (right, width)] } else { [(0, width), (width, width)] };
            let run = move |(from, to): (i64, i64)| (from as usize, y as usize, (to - from).max(0) as usize);
            runs.map(run).into_iter().filter(|(_, _, length)| *length > 0)
        })
    }
}

/// See [`Window::clip`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::image) struct Clipped {
    pub(in crate::image) skipped: usize,
    pub(in crate::image) x: usize,
    pub(in crate::image) y: usize,
    pub(in crate::image) length: usize,
}

impl fmt::Display for Window {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.size())?;
        if (self.x, self.y) == (0, 0) { Ok(()) } else { write!(f, " from {}, {} on", self.x, self.y) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs inside and outside are the frame, each pixel once.
    #[test]
    fn a_window_and_what_is_outside_make_the_frame() {
        let frame = Window { x: -2, y: 3, width: 7, height: 5 };
        for (x, y, width, height) in
            [(-2, 3, 7, 5), (0, 4, 3, 2), (-9, 0, 30, 30), (-4, 5, 5, 9), (9, 9, 2, 2), (-2, 8, 7, 1)]
        {
            let window = Window { x, y, width, height };
            let mut counts = [0; 35];
            for (x, y, length) in window.outside(&frame) {
                (x..x + length).for_each(|x| counts[y * 7 + x] += 1);
            }
            for row in 0..height as usize {
                if let Some(found) = window.clip(&frame, (0, row), width as usize) {
                    (found.x..found.x + found.length).for_each(|x| counts[found.y * 7 + x] += 1);
                    assert_eq!(window.x + found.skipped as i64, frame.x + found.x as i64);
                }
            }
            assert_eq!(counts, [1; 35], "{window}");
            assert_eq!(
                window.meets(&frame),
                (0..height as usize).any(|y| window.clip(&frame, (0, y), width as usize).is_some())
            );
        }
    }
}
