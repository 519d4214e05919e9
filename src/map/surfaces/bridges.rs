//! Lines that break off inside a thin wall, joined again.
//!
//! Between the two faces of a wall thinner than a cell a field is nearly zero all over, and which face a line follows
//! is luck: it breaks off where it changes sides. Ends nearer to each other than a cell, with nothing but wall between
//! them, belong to one line. The nearest two are joined first; every end is joined once.

use rstar::RTree;
use rstar::primitives::GeomWithData;

use crate::geometry::Vec2;
use crate::map::Chart;

/// Ends this many cells apart are joined.
const REACH: f64 = 1.0;
/// Between joined ends the field is nowhere longer than this many cells.
const WITHIN: f64 = 0.5;

/// An end of a line: end `2 k` is where line `k` begins, `2 k + 1` where it ends.
type End = usize;

/// The lines, joined where they broke off inside a wall.
pub(super) fn bridged(chart: Chart<'_>, lines: Vec<Vec<Vec2>>) -> Vec<Vec<Vec2>> {
    let place = |end: End| lines[end / 2][if end.is_multiple_of(2) { 0 } else { lines[end / 2].len() - 1 }];
    let open = (0..2 * lines.len()).filter(|end| place(end - end % 2) != place(end - end % 2 + 1));
    let tree: RTree<GeomWithData<[f64; 2], End>> =
        RTree::bulk_load(open.clone().map(|end| GeomWithData::new(place(end).into(), end)).collect());
    let reach = REACH * chart.field.lattice().resolution;
    let mut pairs: Vec<(f64, End, End)> = open
        .flat_map(|end| {
            let near = tree.locate_within_distance(place(end).into(), reach * reach);
            near.map(move |other| (end, other.data)).collect::<Vec<_>>()
        })
        .filter(|(end, other)| end < other && end / 2 != other / 2)
        .filter(|(end, other)| is_wall_between(chart, place(*end), place(*other)))
        .map(|(end, other)| ((place(end) - place(other)).norm(), end, other))
        .collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut partner: Vec<Option<End>> = vec![None; 2 * lines.len()];
    for (_, end, other) in pairs {
        if partner[end].is_none() && partner[other].is_none() {
            partner[end] = Some(other);
            partner[other] = Some(end);
        }
    }
    chained(&lines, &partner)
}

fn is_wall_between(chart: Chart<'_>, a: Vec2, b: Vec2) -> bool {
    [0.25, 0.5, 0.75].map(|share| a + (b - a) * share).into_iter().all(|p| {
        chart.evidence.at(chart.field.lattice(), p).surface
            && chart.field.value(p).is_some_and(|length| length <= WITHIN * chart.field.lattice().resolution)
    })
}

/// Walks from line to line over joined ends: from free ends first, then around what is closed.
fn chained(lines: &[Vec<Vec2>], partner: &[Option<End>]) -> Vec<Vec<Vec2>> {
    let mut used = vec![false; lines.len()];
    let free = (0..partner.len()).filter(|&end| partner[end].is_none());
    let mut walks = Vec::new();
    for start in free.chain(0..partner.len()) {
        let (mut walk, mut at) = (Vec::new(), start);
        while !used[at / 2] {
            used[at / 2] = true;
            let own = &lines[at / 2];
            if at.is_multiple_of(2) {
                walk.extend(own)
            } else {
                walk.extend(own.iter().rev())
            }
            match partner[at ^ 1] {
                Some(next) if used[next / 2] => walk.extend(walk.first().copied()),
                Some(next) => at = next,
                None => break,
            }
        }
        if !walk.is_empty() {
            walks.push(walk);
        }
    }
    walks
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(from: f64, to: f64) -> Vec<Vec2> {
        vec![Vec2::new(from, 0.0), Vec2::new(to, 0.0)]
    }

    #[test]
    fn a_walk_goes_through_lines_whichever_way_they_run() {
        // 0 to 1, then 3 back to 2, then 4 to 5.
        let lines = [line(0.0, 1.0), line(3.0, 2.0), line(4.0, 5.0)];
        let mut partner = vec![None; 6];
        for (a, b) in [(1, 3), (2, 4)] {
            (partner[a], partner[b]) = (Some(b), Some(a));
        }
        let walks = chained(&lines, &partner);
        assert_eq!(walks.len(), 1);
        assert!(walks[0].iter().map(|p| p.x).eq([0.0, 1.0, 2.0, 3.0, 4.0, 5.0]));
    }

    #[test]
    fn what_is_joined_all_around_is_closed() {
        let lines = [line(0.0, 1.0), line(2.0, 3.0)];
        let partner = vec![Some(3), Some(2), Some(1), Some(0)];
        let walks = chained(&lines, &partner);
        assert!(walks.len() == 1 && walks[0].len() == 5 && walks[0][0] == walks[0][4]);
    }
}
