//! SVG to PNG with a font that is compiled in, and pixel buffers to PNG.

use std::sync::{Arc, LazyLock};

use resvg::{tiny_skia, usvg};

use super::RenderError;

/// The family of the bundled font.
pub(crate) const FONT: &str = "DejaVu Sans";

static FONTS: LazyLock<Arc<usvg::fontdb::Database>> = LazyLock::new(|| {
    let mut fonts = usvg::fontdb::Database::new();
    fonts.load_font_data(include_bytes!("../../assets/fonts/DejaVuSans.ttf").to_vec());
    fonts.set_sans_serif_family(FONT);
    fonts.set_serif_family(FONT);
    fonts.set_monospace_family(FONT);
    Arc::new(fonts)
});

/// Rasterises an SVG at its own size.
pub fn svg_to_png(svg: &str) -> Result<Vec<u8>, RenderError> {
    let options = usvg::Options {
        font_family: FONT.into(),
        fontdb: FONTS.clone(),
        // Nothing outside the document is ever read.
        image_href_resolver: usvg::ImageHrefResolver { resolve_string: Box::new(|_, _| None), ..Default::default() },
        ..Default::default()
    };
    let tree = usvg::Tree::from_str(svg, &options).map_err(|error| RenderError::Svg(error.to_string()))?;
    let size = tree.size().to_int_size();
    let mut pixels = tiny_skia::Pixmap::new(size.width(), size.height())
        .ok_or_else(|| RenderError::Svg("the picture has no pixels".into()))?;
    pixels.fill(tiny_skia::Color::WHITE);
    resvg::render(&tree, tiny_skia::Transform::identity(), &mut pixels.as_mut());
    rgba_png(size.width(), size.height(), &pixels.take_demultiplied())
}

/// Eight-bit grey pixels, top row first.
pub fn grayscale_png(width: u32, height: u32, pixels: &[u8]) -> Result<Vec<u8>, RenderError> {
    encode(width, height, png::ColorType::Grayscale, pixels)
}

/// Straight RGBA pixels, top row first.
pub fn rgba_png(width: u32, height: u32, pixels: &[u8]) -> Result<Vec<u8>, RenderError> {
    encode(width, height, png::ColorType::Rgba, pixels)
}

fn encode(width: u32, height: u32, color: png::ColorType, pixels: &[u8]) -> Result<Vec<u8>, RenderError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(color);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(pixels)?;
    writer.finish()?;
    Ok(bytes)
}
