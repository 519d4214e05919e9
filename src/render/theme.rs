//! What is drawn in which colour, on a light page and on a dark one.
//!
//! Layers have the ramps of the tiles (`tile`), but for signed distance on a dark page: there zero is dark, or the
//! walls would lie in the glare of everything near them. Crameri's "berlin" is that ramp (doi:10.5281/zenodo.1243862).

use colorous::Gradient;

/// The page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Theme {
    #[default]
    Light,
    Dark,
}

/// The colours of a page, as SVG has them.
pub(super) struct Colors {
    pub page: &'static str,
    pub ink: &'static str,
    /// What is said beside the point.
    pub faint: &'static str,
    pub contour: &'static str,
    /// Around contours and poses, so that they are seen on any colour.
    pub halo: &'static str,
    pub band: &'static str,
    pub returns: &'static str,
    pub poses: &'static str,
    pub jumps: &'static str,
}

const LIGHT: Colors = Colors {
    page: "#ffffff",
    ink: "#222222",
    faint: "#666666",
    contour: "#000000",
    halo: "#ffffff",
    band: "#1b9e77",
    returns: "#d95f02",
    poses: "#6a3d9a",
    jumps: "#e7298a",
};

const DARK: Colors = Colors {
    page: "#14171c",
    ink: "#e6e6e6",
    faint: "#9aa3ad",
    contour: "#ffffff",
    halo: "#0b0d10",
    band: "#34d399",
    returns: "#ffb454",
    poses: "#c9a6ff",
    jumps: "#7fe7ff",
};

/// Negative to positive.
const BERLIN: [[u8; 3]; 10] = [
    [158, 176, 255],
    [90, 163, 218],
    [45, 117, 151],
    [25, 65, 85],
    [17, 25, 30],
    [39, 12, 1],
    [80, 24, 2],
    [138, 63, 42],
    [195, 116, 105],
    [255, 172, 172],
];

impl Theme {
    pub(super) fn colors(self) -> &'static Colors {
        match self {
            Self::Light => &LIGHT,
            Self::Dark => &DARK,
        }
    }

    /// What nobody saw.
    pub(super) fn unseen(self) -> [u8; 3] {
        match self {
            Self::Light => [214, 214, 214],
            Self::Dark => [46, 51, 59],
        }
    }

    /// The same in a grid of occupancy, whose ramp is grey.
    pub(super) fn unknown(self) -> [u8; 3] {
        match self {
            Self::Light => [167, 197, 214],
            Self::Dark => [48, 71, 92],
        }
    }

    /// From 0 at a surface to 1 where distance is longest.
    pub(super) fn distance(self, share: f64) -> [u8; 3] {
        match self {
            Self::Light => shade(colorous::YELLOW_GREEN_BLUE, share),
            Self::Dark => shade(colorous::INFERNO, share),
        }
    }

    /// From 0, deepest in free space, over 1/2 at a surface to 1.
    pub(super) fn signed(self, share: f64) -> [u8; 3] {
        match self {
            Self::Light => shade(colorous::RED_BLUE, 1.0 - share),
            Self::Dark => between(&BERLIN, share),
        }
    }

    pub(super) fn sigma(self, share: f64) -> [u8; 3] {
        shade(colorous::VIRIDIS, share)
    }

    /// From 0, free, to 1, occupied, which is what the page is not.
    pub(super) fn occupancy(self, share: f64) -> [u8; 3] {
        match self {
            Self::Light => shade(colorous::GREYS, share),
            Self::Dark => shade(colorous::GREYS, 1.0 - share),
        }
    }
}

pub(crate) fn shade(gradient: Gradient, t: f64) -> [u8; 3] {
    gradient.eval_continuous(if t.is_finite() { t.clamp(0.0, 1.0) } else { 0.0 }).as_array()
}

/// A ramp that many points ask, a step of a colour's eight bits from it at most.
pub(super) struct Ramp(Vec<[u8; 3]>);

impl Ramp {
    const STEPS: usize = 1024;

    pub(super) fn of(color: impl Fn(f64) -> [u8; 3]) -> Self {
        Self((0..=Self::STEPS).map(|k| color(k as f64 / Self::STEPS as f64)).collect())
    }

    /// The colour at a share, or at the nearest end.
    pub(super) fn at(&self, share: f64) -> [u8; 3] {
        // What is no number is at the beginning, as a cast has it.
        self.0[((share * Self::STEPS as f64 + 0.5) as usize).min(Self::STEPS)]
    }
}

/// A ramp's colour there, linear between its stops.
fn between(stops: &[[u8; 3]], t: f64) -> [u8; 3] {
    let last = stops.len() - 1;
    let at = if t.is_finite() { t.clamp(0.0, 1.0) * last as f64 } else { 0.0 };
    let k = (at as usize).min(last - 1);
    mixed(stops[k], stops[k + 1], at - k as f64)
}

/// A colour on its way from one to another.
pub(super) fn mixed(from: [u8; 3], to: [u8; 3], share: f64) -> [u8; 3] {
    std::array::from_fn(|k| (f64::from(from[k]) * (1.0 - share) + f64::from(to[k]) * share).round() as u8)
}

pub(super) fn css([r, g, b]: [u8; 3]) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ramps_end_where_they_should() {
        assert_eq!((between(&BERLIN, 0.0), between(&BERLIN, 1.0)), (BERLIN[0], BERLIN[9]));
        assert_eq!(between(&BERLIN, f64::NAN), BERLIN[0]);
        assert_eq!((Theme::Light.occupancy(1.0), Theme::Dark.occupancy(0.0)), ([0; 3], [0; 3]));
    }

    #[test]
    fn a_ramp_has_the_colours_that_it_was_made_of() {
        let ramp = Ramp::of(|share| Theme::Light.sigma(share));
        for k in 0..=10_000 {
            let share = f64::from(k) / 10_000.0;
            let off = ramp.at(share).iter().zip(Theme::Light.sigma(share)).map(|(a, b)| a.abs_diff(b)).max();
            assert!(off <= Some(1), "{off:?} at {share}");
        }
        let ends = [f64::NEG_INFINITY, -0.1, f64::NAN, 1.1, f64::INFINITY].map(|share| ramp.at(share));
        let [first, last] = [0.0, 1.0].map(|share| Theme::Light.sigma(share));
        assert_eq!(ends, [first, first, first, last, last]);
    }

    #[test]
    fn free_space_of_a_signed_map_is_blue_on_either_page() {
        for theme in [Theme::Light, Theme::Dark] {
            let ([red, _, blue], [other, _, there]) = (theme.signed(0.1), theme.signed(0.9));
            assert!(blue > red && other > there);
        }
    }
}
