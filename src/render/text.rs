//! Words and numbers in a figure.

/// A text's width in points at a size, about and rather more: classes of the bundled font's letters.
pub(super) fn width(text: &str, size: f64) -> f64 {
    let of = |c: char| match c {
        'i' | 'j' | 'l' | '.' | ',' | ':' | ';' | '\'' | '|' | '!' | ' ' => 0.34,
        't' | 'f' | 'r' | 'I' | '(' | ')' | '[' | ']' | '/' | '-' => 0.42,
        'm' | 'w' | 'M' | 'W' | '@' | '%' | '=' | '\u{2212}' => 1.0,
        c if c.is_uppercase() => 0.76,
        c if c as u32 > 0x2e80 => 1.05,
        _ => 0.64,
    };
    size * text.chars().map(of).sum::<f64>()
}

/// The text, or as much of it as fits.
pub(super) fn shortened(text: &str, size: f64, room: f64) -> String {
    if width(text, size) <= room {
        return text.to_owned();
    }
    let room = room - width("...", size);
    let mut kept: String = text.to_owned();
    while !kept.is_empty() && width(&kept, size) > room {
        kept.pop();
    }
    kept.truncate(kept.trim_end().len());
    kept + "..."
}

/// Round numbers between `low` and `high`, about `count` of them: steps of 1, 2 or 5 times a power of ten.
pub(super) fn ticks(low: f64, high: f64, count: f64) -> Vec<f64> {
    let span = high - low;
    if !(span > 0.0 && span.is_finite()) {
        return vec![low];
    }
    let raw = span / count;
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= raw).unwrap_or(power * 10.0);
    let (first, last) = ((low / step - 1e-9).ceil() as i64, (high / step + 1e-9).floor() as i64);
    (first..=last).map(|k| k as f64 * step).collect()
}

/// The largest round length that is no longer.
pub(super) fn round_length(longest: f64) -> f64 {
    let power = 10f64.powf(longest.log10().floor());
    [5.0, 2.0, 1.0].into_iter().map(|m| m * power).find(|length| *length <= longest).unwrap_or(power)
}

pub(super) fn number(value: f64) -> String {
    let rounded = (value * 1e6).round() / 1e6;
    if rounded < 0.0 { format!("\u{2212}{}", -rounded) } else { format!("{}", rounded.abs()) }
}

/// `4th`.
pub(super) fn ordinal(n: usize) -> String {
    let ending = match (n % 10, n % 100) {
        (_, 11..=13) => "th",
        (1, _) => "st",
        (2, _) => "nd",
        (3, _) => "rd",
        _ => "th",
    };
    format!("{n}{ending}")
}

/// A text as XML may hold it.
pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .chars()
        .filter(|c| !c.is_control() && !matches!(c, '\u{fffe}' | '\u{ffff}'))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks(-0.6, 8.6, 6.0), [0.0, 2.0, 4.0, 6.0, 8.0]);
        assert_eq!(ticks(0.0, 0.03, 3.0), [0.0, 0.01, 0.02, 0.03]);
        assert_eq!(ticks(1.0, 1.0, 5.0), [1.0]);
    }

    #[test]
    fn scale_bars_are_round() {
        assert_eq!([7.3, 1.0, 0.3, 49.0].map(round_length), [5.0, 1.0, 0.2, 20.0]);
    }

    #[test]
    fn what_does_not_fit_is_shortened_and_says_so() {
        assert_eq!(shortened("lab", 12.0, 100.0), "lab");
        let cut = shortened(&"a long name ".repeat(20), 12.0, 100.0);
        assert!(cut.ends_with("...") && width(&cut, 12.0) <= 100.0 && cut.len() > 8, "{cut}");
    }

    #[test]
    fn ordinals_are_english() {
        assert_eq!([1, 2, 3, 4, 11, 12, 22, 113].map(ordinal).join(" "), "1st 2nd 3rd 4th 11th 12th 22nd 113th");
    }
}
