//! Several figures side by side, as one SVG document.

use std::fmt::Write;

use super::figure::Figure;

/// A row of figures.
#[derive(Default)]
pub struct Sheet {
    panels: String,
    width: f64,
    height: f64,
}

impl Sheet {
    /// Adds a figure at the right.
    pub fn with(mut self, figure: Figure) -> Self {
        let [width, height] = figure.axes.figure_size();
        let _ = write!(self.panels, "<svg x=\"{}\" y=\"0\"{}", self.width, figure.finish().trim_start_matches("<svg"));
        self.width += width;
        self.height = self.height.max(height);
        self
    }

    /// Adds a figure below all others.
    pub fn below(mut self, figure: Figure) -> Self {
        let [width, height] = figure.axes.figure_size();
        let _ = write!(self.panels, "<svg x=\"0\" y=\"{}\"{}", self.height, figure.finish().trim_start_matches("<svg"));
        self.width = self.width.max(width);
        self.height += height;
        self
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
