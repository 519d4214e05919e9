//! Several figures, beside and below each other, as one SVG document with one title.

use std::fmt::Write;

use super::figure::Figure;
use super::raster::FONT;
use super::text::escaped;

/// The title's line, in pixels.
const HEAD: f64 = 34.0;

/// Figures on one page.
pub struct Sheet {
    title: String,
    panels: String,
    width: f64,
    height: f64,
    /// Where the row begins that figures are being added to, and ends so far.
    row: [f64; 2],
}

impl Sheet {
    /// A page whose figures share a title; their own say what each of them shows of it.
    pub fn new(title: &str) -> Self {
        Self { title: title.to_owned(), panels: String::new(), width: 0.0, height: HEAD, row: [HEAD, 0.0] }
    }

    /// Adds a figure at the right of the row.
    pub fn with(mut self, figure: Figure) -> Self {
        let [top, left] = self.row;
        let [width, height] = self.place(figure, [left, top]);
        self.row[1] += width;
        self.width = self.width.max(self.row[1]);
        self.height = self.height.max(top + height);
        self
    }

    /// Adds a figure below all others, and begins a row with it.
    pub fn below(mut self, figure: Figure) -> Self {
        self.row = [self.height, 0.0];
        self.with(figure)
    }

    /// Writes a figure with its upper left corner there, and tells its size.
    fn place(&mut self, figure: Figure, [x, y]: [f64; 2]) -> [f64; 2] {
        let size = figure.size();
        let _ = write!(self.panels, "<svg x=\"{x}\" y=\"{y}\"{}", figure.finish().trim_start_matches("<svg"));
        size
    }

    /// The document.
    pub fn finish(self) -> String {
        let Self { title, panels, width, height, .. } = self;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" font-family=\"{FONT}, sans-serif\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
             <text x=\"16\" y=\"26\" font-size=\"17\" fill=\"#222222\">{}</text>\n{panels}</svg>\n",
            escaped(&title)
        )
    }
}
