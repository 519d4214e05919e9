//! Several figures, beside and below each other, as one SVG document.

use std::fmt::Write;

use super::figure::Figure;

/// Figures on one page.
#[derive(Default)]
pub struct Sheet {
    panels: String,
    width: f64,
    height: f64,
}

impl Sheet {
    /// Adds a figure at the right.
    pub fn with(mut self, figure: Figure) -> Self {
        let [width, height] = self.place(figure, [self.width, 0.0]);
        self.width += width;
        self.height = self.height.max(height);
        self
    }

    /// Adds a figure below all others.
    pub fn below(mut self, figure: Figure) -> Self {
        let [width, height] = self.place(figure, [0.0, self.height]);
        self.width = self.width.max(width);
        self.height += height;
        self
    }

    /// Writes a figure with its upper left corner there, and tells its size.
    fn place(&mut self, figure: Figure, [x, y]: [f64; 2]) -> [f64; 2] {
        let size = figure.axes.figure_size();
        let _ = write!(self.panels, "<svg x=\"{x}\" y=\"{y}\"{}", figure.finish().trim_start_matches("<svg"));
        size
    }

    /// The document.
    pub fn finish(self) -> String {
        let Self { panels, width, height } = self;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n{panels}</svg>\n"
        )
    }
}
