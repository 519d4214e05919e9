//! Lines with fewer vertices (Ramer 1972, Douglas and Peucker 1973).

use crate::geometry::{Vec2, distance_to_segment};

/// The line's vertices without which it would deviate by more than `tolerance`, no two of them more than `longest`
/// apart where the line has vertices between.
pub(super) fn simplified(line: &[Vec2], tolerance: f64, longest: f64) -> Vec<Vec2> {
    let Some((&first, _)) = line.split_first() else { return Vec::new() };
    let mut kept = vec![first];
    let mut spans = vec![(0, line.len() - 1)];
    while let Some((from, to)) = spans.pop() {
        let middle = (from + 1..to)
            .map(|k| (distance_to_segment(line[k], line[from], line[to]), k))
            .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        match middle {
            Some((off, k)) if off > tolerance => spans.extend([(k, to), (from, k)]),
            Some(_) if (line[to] - line[from]).norm() > longest => {
                let k = from.midpoint(to);
                spans.extend([(k, to), (from, k)]);
            }
            _ if to > from => kept.push(line[to]),
            _ => {}
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_line_keeps_vertices_every_so_often_and_a_corner_stays() {
        let line: Vec<Vec2> = (0..=100)
            .map(|k| f64::from(k) * 0.1)
            .map(|s| if s <= 5.0 { Vec2::new(s, 0.0) } else { Vec2::new(5.0, s - 5.0) })
            .collect();
        let kept = simplified(&line, 1e-3, 1.0);
        assert!(kept.len() < 24 && kept.contains(&line[50]) && kept[0] == line[0] && kept.last() == line.last());
        assert!(kept.windows(2).all(|pair| (pair[1] - pair[0]).norm() <= 1.0 + 1e-9));
    }
}
