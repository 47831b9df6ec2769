//! Pages on paper: reports with tables, and contact sheets, as PDF.

use std::io::Write;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use pdf_writer::{Content, Filter, Finish, Name, Pdf, Rect, Ref, Str};

use super::display::Shown;
use ltm::error::{Error, Result};

/// A page of A4 lying on its side, and its margin, in points.
const PAPER: [f32; 2] = [842.0, 595.0];
const MARGIN: f32 = 36.0;
/// Height of letters, and from line to line.
const LETTERS: f32 = 8.5;
const LINE: f32 = 12.0;
/// Room between columns.
const BETWEEN: f32 = 10.0;
/// Height of a report's picture at most.
const PICTURE: f32 = 260.0;
/// Pictures across and down a contact sheet.
const GRID: [usize; 2] = [3, 2];

/// Rows of cells.
pub type Table = Vec<Vec<String>>;

/// A report: a title, a picture with what is to be said of it, and tables, whose first rows are heads.
///
/// # Errors
/// A picture that has no pixels.
pub fn report(title: &str, picture: Option<(&Shown, &str)>, tables: &[Table]) -> Result<Vec<u8>> {
    let mut pages = Pages::new();
    pages.write(MARGIN, 14.0, title);
    pages.below -= 22.0;
    if let Some((shown, about)) = picture {
        let size = fitting(shown, [PAPER[0] - 2.0 * MARGIN, PICTURE])?;
        let below = pages.below - size[1];
        pages.image(shown, [MARGIN, below], size)?;
        pages.below = below - LINE;
        pages.write(MARGIN, LETTERS, about);
        pages.below -= 2.0 * LINE;
    }
    for table in tables {
        pages.table(table);
        pages.below -= LINE;
    }
    Ok(pages.finish())
}

/// Pictures over their names, six to a page.
///
/// # Errors
/// There is none, or one has no pixels.
pub fn sheet(pictures: &[(String, Shown)]) -> Result<Vec<u8>> {
    if pictures.is_empty() {
        return Err(Error::input("the contact sheet", "has no pictures", "keep a snapshot"));
    }
    let mut pages = Pages::new();
    let cell = [0, 1].map(|axis| (PAPER[axis] - 2.0 * MARGIN + BETWEEN) / GRID[axis] as f32);
    for (index, (name, shown)) in pictures.iter().enumerate() {
        let at = index % (GRID[0] * GRID[1]);
        if index > 0 && at == 0 {
            pages.turn();
        }
        let left = MARGIN + (at % GRID[0]) as f32 * cell[0];
        let top = PAPER[1] - MARGIN - (at / GRID[0]) as f32 * cell[1];
        let size = fitting(shown, [cell[0] - BETWEEN, cell[1] - BETWEEN - 2.0 * LINE])?;
        pages.image(shown, [left, top - size[1]], size)?;
        pages.below = top - size[1] - LINE;
        pages.write(left, LETTERS, &cut(name, cell[0] - BETWEEN));
    }
    Ok(pages.finish())
}

/// The size of a picture in a room of this size.
fn fitting(shown: &Shown, room: [f32; 2]) -> Result<[f32; 2]> {
    if shown.size.contains(&0) {
        return Err(Error::input("the PDF", "has a picture without pixels", ""));
    }
    let size = shown.size.map(|v| v as f32);
    let scale = (room[0] / size[0]).min(room[1] / size[1]);
    Ok(size.map(|v| v * scale))
}

/// A document that is being written, page by page.
struct Pages {
    pdf: Pdf,
    next: i32,
    done: Vec<Ref>,
    content: Content,
    /// Images of the page that is being written.
    images: Vec<Ref>,
    /// Lower end of the free part of the page, from below.
    below: f32,
}

const CATALOG: Ref = Ref::new(1);
const TREE: Ref = Ref::new(2);
const FONT: Ref = Ref::new(3);

impl Pages {
    fn new() -> Self {
        let mut pdf = Pdf::new();
        pdf.catalog(CATALOG).pages(TREE);
        // One of the typefaces that every reader has, so that none is carried along.
        pdf.type1_font(FONT).base_font(Name(b"Helvetica")).encoding_predefined(Name(b"WinAnsiEncoding"));
        let (done, content, images) = (Vec::new(), Content::new(), Vec::new());
        Self { pdf, next: 4, done, content, images, below: PAPER[1] - MARGIN }
    }

    fn reference(&mut self) -> Ref {
        self.next += 1;
        Ref::new(self.next - 1)
    }

    /// Writes a line whose letters stand on what is filled.
    fn write(&mut self, left: f32, size: f32, text: &str) {
        self.content.begin_text();
        self.content.set_font(Name(b"F"), size);
        self.content.next_line(left, self.below - size);
        self.content.show(Str(&in_latin(text)));
        self.content.end_text();
    }

    fn image(&mut self, shown: &Shown, [left, bottom]: [f32; 2], [width, height]: [f32; 2]) -> Result<()> {
        let rgb: Vec<u8> = shown.rgba.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
        let mut packed = ZlibEncoder::new(Vec::new(), Compression::default());
        let packed = packed.write_all(&rgb).and_then(|()| packed.finish());
        let packed = packed.map_err(|error| Error::input("the PDF", error.to_string(), ""))?;
        let id = self.reference();
        let mut image = self.pdf.image_xobject(id, &packed);
        image.filter(Filter::FlateDecode);
        image.width(shown.size[0] as i32).height(shown.size[1] as i32);
        image.color_space().device_rgb();
        image.bits_per_component(8);
        image.finish();
        let name = format!("I{}", self.images.len());
        self.images.push(id);
        self.content.save_state();
        self.content.transform([width, 0.0, 0.0, height, left, bottom]);
        self.content.x_object(Name(name.as_bytes()));
        self.content.restore_state();
        Ok(())
    }

    fn table(&mut self, table: &Table) {
        let columns = table.iter().map(Vec::len).max().unwrap_or(0);
        let widest =
            |column: usize| table.iter().filter_map(|row| row.get(column)).map(|cell| width(cell)).fold(0.0, f32::max);
        let mut widths: Vec<f32> = (0..columns).map(widest).collect();
        let room = PAPER[0] - 2.0 * MARGIN - BETWEEN * columns.saturating_sub(1) as f32;
        // The widest column gives way where all do not fit.
        while let (over, Some(most)) =
            (widths.iter().sum::<f32>() - room, (0..columns).max_by(|&a, &b| widths[a].total_cmp(&widths[b])))
            && over > 0.5
        {
            let others = widths.iter().enumerate().filter(|(i, _)| *i != most).map(|(_, w)| *w).fold(0.0, f32::max);
            widths[most] -= over.min((widths[most] - others).max(1.0));
        }
        for (index, row) in table.iter().enumerate() {
            if self.below < MARGIN + LINE {
                self.turn();
            }
            let mut left = MARGIN;
            for (cell, width) in row.iter().zip(&widths) {
                self.write(left, LETTERS, &cut(cell, *width));
                left += width + BETWEEN;
            }
            if index == 0 && columns > 2 && table.len() > 1 {
                let y = self.below - LETTERS - 2.5;
                self.content.set_line_width(0.4).move_to(MARGIN, y).line_to(left - BETWEEN, y).stroke();
            }
            self.below -= LINE;
        }
    }

    /// Ends the page and begins another.
    fn turn(&mut self) {
        let (page_id, content_id) = (self.reference(), self.reference());
        let content = std::mem::replace(&mut self.content, Content::new()).finish();
        self.pdf.stream(content_id, &content);
        let mut page = self.pdf.page(page_id);
        page.media_box(Rect::new(0.0, 0.0, PAPER[0], PAPER[1])).parent(TREE).contents(content_id);
        let mut resources = page.resources();
        resources.fonts().pair(Name(b"F"), FONT);
        let mut objects = resources.x_objects();
        for (index, id) in self.images.drain(..).enumerate() {
            objects.pair(Name(format!("I{index}").as_bytes()), id);
        }
        objects.finish();
        resources.finish();
        page.finish();
        self.done.push(page_id);
        self.below = PAPER[1] - MARGIN;
    }

    fn finish(mut self) -> Vec<u8> {
        self.turn();
        let count = self.done.len() as i32;
        self.pdf.pages(TREE).kids(self.done.iter().copied()).count(count);
        self.pdf.finish()
    }
}

/// A text in the signs of Western Europe, which are all that the typeface has.
fn in_latin(text: &str) -> Vec<u8> {
    let sign = |c: char| match c {
        '≥' => b">=".to_vec(),
        '…' => b"...".to_vec(),
        '–' | '−' => b"-".to_vec(),
        c if u32::from(c) < 256 && !c.is_control() => vec![u32::from(c) as u8],
        _ => b"?".to_vec(),
    };
    text.chars().flat_map(sign).collect()
}

/// About how wide a text is, in points: never less than it is.
fn width(text: &str) -> f32 {
    let of = |sign: u8| match sign {
        b'i' | b'l' | b'j' | b'\'' | b'|' => 0.26,
        b'.' | b',' | b':' | b';' | b'!' | b'/' | b' ' | b't' | b'f' | b'I' => 0.29,
        b'r' | b'-' | b'(' | b')' | b'[' | b']' => 0.34,
        b'm' | b'M' => 0.84,
        b'W' | b'@' | b'%' => 1.02,
        b'w' | b'A'..=b'Z' => 0.79,
        0x80.. => 0.79,
        _ => 0.59,
    };
    in_latin(text).into_iter().map(of).sum::<f32>() * LETTERS
}

/// A text, cut where it would be wider than this.
fn cut(text: &str, most: f32) -> String {
    if width(text) <= most + 0.01 {
        return text.to_owned();
    }
    let mut kept = String::new();
    for c in text.chars() {
        if width(&kept) + width("…") + width(&c.to_string()) > most {
            break;
        }
        kept.push(c);
    }
    kept + "…"
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(size: [usize; 2]) -> Shown {
        Shown { size, rgba: [9, 90, 200, 255].repeat(size[0] * size[1]), histogram: Vec::new() }
    }

    fn count(pdf: &[u8], text: &str) -> usize {
        pdf.windows(text.len()).filter(|part| *part == text.as_bytes()).count()
    }

    #[test]
    fn a_long_report_goes_over_several_pages() {
        let row = |i: usize| vec![format!("lamp {i}"), "400 lm".to_owned(), "≥ 3.2 cd/m²".to_owned()];
        let table: Table = (0..120).map(row).collect();
        let shown = picture([64, 48]);
        let pdf = report("room.ltc", Some((&shown, "as shown")), &[table, vec![vec!["one".into()]]]).unwrap();
        assert!(pdf.starts_with(b"%PDF-1.") && count(&pdf, "%%EOF") == 1);
        // 17 rows below the picture, 43 on each page that follows.
        assert_eq!(count(&pdf, "/Type /Page\n") + count(&pdf, "/Type /Page "), 4);
        assert_eq!(count(&pdf, "/Subtype /Image"), 1);
        for text in ["(lamp 0)", "(lamp 119)", "(room.ltc)", "(one)"] {
            assert_eq!(count(&pdf, text), 1, "{text}");
        }
    }

    #[test]
    fn a_sheet_has_every_picture_over_its_name() {
        let pictures: Vec<_> = (0..7).map(|i| (format!("Look {i}"), picture([30, 20]))).collect();
        let pdf = sheet(&pictures).unwrap();
        assert_eq!((count(&pdf, "/Subtype /Image"), count(&pdf, "(Look 6)")), (7, 1));
        assert!(sheet(&[]).is_err() && sheet(&[("none".into(), picture([0, 0]))]).is_err());
    }

    #[test]
    fn what_is_too_wide_is_cut_and_what_the_typeface_lacks_is_marked() {
        let long = "a very long name of a lamp in a corner";
        let short = cut(long, 60.0);
        assert!(width(&short) <= 60.0 && short.ends_with('…') && long.starts_with(short.trim_end_matches('…')));
        assert_eq!(cut("lamp", 100.0), "lamp");
        assert_eq!(in_latin("Küche ≥ 灯"), b"K\xfcche >= ?");
        // A table that is wider than the page is made to fit, and nothing hangs.
        let table: Table = vec![(0..12).map(|_| "x".repeat(80)).collect()];
        assert!(report("wide", None, &[table]).is_ok());
    }
}
