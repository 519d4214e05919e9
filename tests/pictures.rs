//! Pictures of maps, as a reader sees them: read from the SVG that the service sends.

mod support;

use std::collections::BTreeSet;

use resvg::usvg::roxmltree::{Document, Node};
use serde_json::{Value, json};
use support::{Server, experiment_one, small};

/// A picture of a map, as text.
fn picture(server: &Server, path: &str) -> String {
    let answer = server.get(path);
    assert_eq!((answer.status, answer.header("content-type")), (200, "image/svg+xml"), "{path}");
    String::from_utf8(answer.body).unwrap()
}

fn number(node: Node, name: &str) -> f64 {
    node.attribute(name).unwrap_or_else(|| panic!("{name} of {node:?}")).parse().unwrap()
}

fn classed<'a>(svg: &'a Document, class: &str) -> Option<Node<'a, 'a>> {
    svg.descendants().find(|node| node.attribute("class") == Some(class))
}

/// Pixels a unit of the document, and its size in pixels.
fn scale_and_size(svg: &Document) -> (f64, [f64; 2]) {
    let root = svg.root_element();
    let view: Vec<f64> = root.attribute("viewBox").unwrap().split(' ').map(|n| n.parse().unwrap()).collect();
    let size = ["width", "height"].map(|name| number(root, name));
    assert!((size[0] / view[2] - size[1] / view[3]).abs() < 1e-3, "not stretched");
    (size[0] / view[2], size)
}

/// The names in the legend.
fn legend(svg: &Document) -> BTreeSet<String> {
    let texts = classed(svg, "legend").into_iter().flat_map(|group| group.descendants());
    texts.filter(|node| node.has_tag_name("text")).map(|node| node.text().unwrap().to_owned()).collect()
}

fn names(of: &[&str]) -> BTreeSet<String> {
    of.iter().map(|name| (*name).to_owned()).collect()
}

/// Left and top of the plot in pixels, and its size in pixels.
fn plot(svg: &Document) -> ([f64; 2], [f64; 2]) {
    let scale = scale_and_size(svg).0;
    let transform = classed(svg, "plot").unwrap().attribute("transform").unwrap();
    let at = transform.trim_start_matches("translate(").trim_end_matches(')');
    let at: Vec<f64> = at.split(' ').map(|n| n.parse::<f64>().unwrap() * scale).collect();
    let frame = classed(svg, "frame").unwrap();
    ([at[0], at[1]], ["width", "height"].map(|name| number(frame, name) * scale))
}

#[test]
fn type_lines_and_margins_grow_with_the_width() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 1);
    let own = format!("/v1/maps/{}", server.map_of(&small(1)));
    let at = |width: usize| picture(&server, &format!("{own}/image?overlay=contour&format=svg&width={width}"));
    let measured = |text: &str| {
        let svg = Document::parse(text).unwrap();
        let (scale, size) = scale_and_size(&svg);
        let (corner, [plot_width, _]) = plot(&svg);
        // The document's own type and lines have the same numbers at every width.
        let tick = svg.descendants().filter(|node| node.attribute("text-anchor") == Some("end"));
        assert!(tick.count() > 2 && svg.root_element().attribute("font-size") == Some("12"));
        (scale, size[0], corner, size[0] - corner[0] - plot_width)
    };
    let (scale, width, corner, right) = measured(&at(1000));
    assert_eq!(width, 1000.0);
    let (other_scale, other_width, other_corner, other_right) = measured(&at(3000));
    assert_eq!(other_width, 3000.0);
    assert!((other_scale / scale - 3.0).abs() < 1e-3, "type and lines");
    for (margin, other) in [(corner[0], other_corner[0]), (corner[1], other_corner[1]), (right, other_right)] {
        assert!((other / margin - 3.0).abs() < 0.05, "{margin} and {other}");
    }
    // A thumbnail's type does not shrink until nobody can read it, and leaves the map most of the room.
    let (least, width, corner, right) = measured(&at(300));
    assert!(12.0 * least > 8.0 && corner[0] + right < 0.4 * width, "{least} {corner:?} {right}");
}

#[test]
fn the_legend_names_what_is_drawn_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 1);
    let own = format!("/v1/maps/{}", server.map_of(&small(1)));
    let named = |query: &str| legend(&Document::parse(&picture(&server, &format!("{own}/{query}"))).unwrap());
    assert_eq!(named("image?format=svg"), names(&["unseen"]));
    assert_eq!(
        named("image?format=svg&overlay=poses,contour,points"),
        names(&["unseen", "returns", "2-sigma band", "contour", "poses"])
    );
    assert_eq!(
        named("image?format=svg&layer=occupancy&overlay=jumps"),
        names(&["unseen"]),
        "a signed map has no jumps"
    );
    assert_eq!(named("contours?format=svg"), names(&["contour"]));
    assert_eq!(named("contours?format=svg&level=-0.5&sigma_band=1").len(), 2);
    assert_eq!(named("contours?format=svg&level=100"), names(&[]), "there is no such place");

    let mut vector = experiment_one(1);
    vector["map"]["distance"] = json!("vdf");
    let own = format!("/v1/maps/{}", server.map_of(&vector));
    let named = |query: &str| legend(&Document::parse(&picture(&server, &format!("{own}/{query}"))).unwrap());
    assert_eq!(named("image?format=svg&overlay=jumps,contour"), names(&["unseen", "jumps", "2-sigma band", "contour"]));
}

#[test]
fn every_picture_says_which_map_it_is_and_how_long_a_metre() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 1);
    let mut request = small(1);
    request["name"] = json!("Hall <2> & \"annex\"");
    let own = format!("/v1/maps/{}", server.map_of(&request));
    for query in ["image?layer=sigma&kind=posterior&format=svg", "contours?kind=posterior&format=svg"] {
        let text = picture(&server, &format!("{own}/{query}"));
        let svg = Document::parse(&text).unwrap();
        let texts: Vec<&str> = svg.descendants().filter_map(|node| node.text()).collect();
        assert!(texts.iter().any(|text| text.starts_with("Hall <2> & \"annex\"")), "{texts:?}");
        assert!(texts.contains(&"h = 0.5 m, signed distance, posterior sigma"), "{texts:?}");
        let bar = classed(&svg, "scale-bar").unwrap();
        let said: f64 = bar.descendants().find_map(|node| node.text()).unwrap().trim_end_matches(" m").parse().unwrap();
        let long = number(bar.descendants().find(|node| node.has_tag_name("rect")).unwrap(), "width");
        let lattice = &server.get(&own).json()["lattice"];
        let metres = lattice["cells"][0].as_f64().unwrap() * lattice["resolution"].as_f64().unwrap();
        let wide = number(classed(&svg, "frame").unwrap(), "width");
        assert!((long / wide - said / metres).abs() < 0.01, "{said} m are {long} of {wide}, which are {metres} m");
    }
}

#[test]
fn colour_bars_are_as_tall_as_the_map_and_have_arrows_where_values_are_cut_off() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 1);
    let own = format!("/v1/maps/{}", server.map_of(&small(1)));
    for (layer, above, below) in [("distance", false, true), ("sigma", true, true), ("occupancy", false, false)] {
        for width in [250, 900, 2000] {
            let text = picture(&server, &format!("{own}/image?layer={layer}&format=svg&width={width}"));
            let svg = Document::parse(&text).unwrap();
            assert_eq!(classed(&svg, "above").is_some(), above, "{layer} at {width}");
            assert_eq!(classed(&svg, "below").is_some(), below, "{layer} at {width}");
            let outline = classed(&svg, "outline").unwrap().attribute("d").unwrap().to_owned();
            let height = number(classed(&svg, "frame").unwrap(), "height");
            // The last number of each piece of the outline is its height in the plot.
            let pieces = outline.split(['M', 'L', 'V', 'Z']).filter_map(|piece| piece.rsplit(' ').next()?.parse().ok());
            let rows: Vec<f64> = pieces.collect();
            let ends = [rows.iter().copied().fold(f64::MAX, f64::min), rows.iter().copied().fold(0.0, f64::max)];
            assert!(ends[0] == 0.0 && (ends[1] - height).abs() < 0.1, "{outline} {height}");
        }
    }
}

#[test]
fn a_dark_picture_is_dark_and_is_another_than_the_light_one() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 1);
    let own = format!("/v1/maps/{}", server.map_of(&small(1)));
    for query in ["image?layer=distance", "image?layer=sigma", "image?layer=occupancy", "contours?sigma_band=2"] {
        let both =
            ["light", "dark"].map(|theme| server.get(&format!("{own}/{query}&theme={theme}&format=png&width=300")));
        assert_eq!(first_pixel(&both[0].body), [255, 255, 255]);
        assert!(first_pixel(&both[1].body).iter().all(|channel| *channel < 50), "{query}");
        assert_eq!(
            server.get(&format!("{own}/{query}&format=png&width=300")).body,
            both[0].body,
            "light is the default"
        );
        let again = server.get(&format!("{own}/{query}&theme=dark&format=png&width=300"));
        assert_eq!(again.body, both[1].body, "the same bytes every time");
    }
    server.get(&format!("{own}/image?theme=sepia")).problem(422);
}

fn first_pixel(png: &[u8]) -> [u8; 3] {
    let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
    let row = reader.next_row().unwrap().unwrap().data().to_vec();
    [row[0], row[1], row[2]]
}

#[test]
fn poses_never_bury_the_map_however_many_there_are() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), 1);
    let mut request = small(1);
    let scans: Vec<Value> = request["scans"].as_array().unwrap().iter().cycle().take(150).cloned().collect();
    request["scans"] = json!(scans);
    request["fit"] = json!({"poses": "fixed"});
    let own = format!("/v1/maps/{}", server.map_of(&request));
    let text = picture(&server, &format!("{own}/image?overlay=poses&format=svg"));
    let svg = Document::parse(&text).unwrap();
    let darts = classed(&svg, "poses").unwrap().attribute("d").unwrap();
    let drawn = darts.matches('M').count();
    assert!((40..=mapfit::render::MOST_POSES).contains(&drawn), "{drawn}");
    assert!(legend(&svg).contains("poses, every 3rd"), "and it says so");
}
