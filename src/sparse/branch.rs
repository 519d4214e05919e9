//! A parcel's work: the same walk as at home, on a tree that is a branch and its border.
//!
//! What comes from elsewhere is not taken on trust: a parcel whose lists do not fit each other is an error, never a panic.

use std::sync::atomic::{AtomicBool, Ordering};

use super::cholesky::Elimination;
use super::error::{LARGEST_FACTOR, SparseError};
use super::pace::Pace;
use super::parcel::{Answer, Parcel, columns, triangle};
use super::selected::{Derivative, Inverse, Sandwich};
use super::team::watched;
use super::tree::Tree;
use super::walk::{Downward, Upward, branch_down, branch_up};

impl Parcel {
    /// Does what is asked. Ends with [`SparseError::Stopped`] soon after `stop` is set; a parcel that is not one is
    /// [`SparseError::Setup`].
    pub fn work(&self, stop: &AtomicBool) -> Result<Answer, SparseError> {
        let branch = Branch::of(self)?;
        if stop.load(Ordering::Relaxed) {
            return Err(SparseError::Stopped);
        }
        let (factor, derivative) = (&self.factor[..], &self.derivative[..]);
        match (self.matrices, factor.is_empty()) {
            (0, true) => branch.up(&Elimination, stop),
            (0, false) => branch.up(&Derivative { factor }, stop),
            (1, _) => branch.down(&Inverse { factor }, stop),
            (2, _) => branch.down(&Sandwich { factor, derivative }, stop),
            _ => Err(not_one("matrices")),
        }
    }
}

/// A branch that stands by itself.
struct Branch<'p> {
    parcel: &'p Parcel,
    /// The branch's supernodes, and one more where there is a border, which owns its rows.
    tree: Tree,
    supernodes: usize,
    /// Entries of the branch's panels.
    entries: usize,
}

fn not_one(what: &str) -> SparseError {
    SparseError::Setup(format!("this is no branch: its {what} do not fit"))
}

fn wide(values: &[u32]) -> Vec<usize> {
    values.iter().map(|&value| value as usize).collect()
}

impl<'p> Branch<'p> {
    fn of(parcel: &'p Parcel) -> Result<Self, SparseError> {
        let (mut begins, mut row_starts, rows) = (wide(&parcel.begins), wide(&parcel.row_starts), wide(&parcel.rows));
        let (supernodes, border) = (begins.len().saturating_sub(1), parcel.border as usize);
        let ascend = |list: &[usize], end: usize| {
            list.first() == Some(&0) && list.last() == Some(&end) && list.is_sorted_by(|a, b| a <= b)
        };
        let steps = begins.last().copied().unwrap_or_default();
        if supernodes == 0 || !begins.is_sorted_by(|a, b| a < b) || !ascend(&begins, steps) {
            return Err(not_one("steps"));
        }
        if row_starts.len() != supernodes + 1 || !ascend(&row_starts, rows.len()) {
            return Err(not_one("rows"));
        }
        if border > 0 {
            begins.push(steps.saturating_add(border));
            row_starts.push(rows.len());
        }
        for s in 0..supernodes {
            let own = &rows[row_starts[s]..row_starts[s + 1]];
            let after = own.first().is_none_or(|&first| first >= begins[s + 1]);
            let within = own.last().is_none_or(|&last| last < steps + border);
            if !after || !within || !own.is_sorted_by(|a, b| a < b) {
                return Err(not_one("rows"));
            }
        }
        // What is allocated next is by what was sent.
        let held = parcel.places.len().max(parcel.factor.len());
        if steps > held || border > rows.len() || parcel.panels() > LARGEST_FACTOR {
            return Err(not_one("sizes"));
        }
        let tree = Tree::of_supernodes(begins, row_starts, rows);
        if !(0..supernodes).all(|s| tree.hands_on_all(s)) {
            return Err(not_one("rows"));
        }
        let entries = tree.span(0..supernodes).len();
        let panels = |values: &[f64]| values.is_empty() || values.len() == entries;
        if !panels(&parcel.factor) || !panels(&parcel.derivative) {
            return Err(not_one("panels"));
        }
        if !parcel.places.iter().chain(&parcel.wanted).all(|&place| (place as usize) < entries) {
            return Err(not_one("places"));
        }
        let above = parcel.matrices as usize * triangle(border);
        if parcel.places.len() != parcel.entries.len() || parcel.above.len() != above {
            return Err(not_one("entries"));
        }
        Ok(Self { parcel, tree, supernodes, entries })
    }

    fn up(&self, pass: &impl Upward, stop: &AtomicBool) -> Result<Answer, SparseError> {
        let mut values = vec![0.0; self.entries];
        let given = self.parcel.places.iter().zip(&self.parcel.entries);
        given.for_each(|(&place, &entry)| values[place as usize] = entry);
        let updates = self.done(stop, |pace| branch_up(&self.tree, 0..self.supernodes, &mut values[..], pass, pace))?;
        let mut handed_on = Vec::new();
        for (_, update) in updates.left() {
            (0..update.ncols()).for_each(|column| handed_on.extend_from_slice(&update.col_as_slice(column)[column..]));
        }
        Ok(Answer { values, handed_on })
    }

    fn down<const K: usize>(&self, pass: &impl Downward<K>, stop: &AtomicBool) -> Result<Answer, SparseError> {
        let sources = pass.sources();
        if sources.factor.len() != self.entries || (K > 1 && sources.derivative.len() != self.entries) {
            return Err(not_one("panels"));
        }
        let border = self.parcel.border as usize;
        // As a panel of the border's supernode: square, of which the lower triangle is read.
        let panels: Vec<Vec<f64>> =
            self.parcel.above.chunks(triangle(border).max(1)).map(|own| square(own, border)).collect();
        let above = |_: usize, k: usize| panels.get(k).map_or(&[][..], |own| &own[..]);
        let wanted = &self.parcel.wanted;
        let kept = self.done(stop, |pace| branch_down(&self.tree, 0..self.supernodes, &above, wanted, pass, pace))?;
        Ok(Answer { values: kept.into_flattened(), handed_on: Vec::new() })
    }

    fn done<R: Send>(
        &self,
        stop: &AtomicBool,
        work: impl FnOnce(&Pace) -> Result<R, SparseError> + Send,
    ) -> Result<R, SparseError> {
        let pace = Pace::of(self.tree.work_of(0..self.supernodes));
        let go_on = |_: f64| !stop.load(Ordering::Relaxed);
        let mut done = Err(SparseError::Stopped);
        watched(Box::new(|| done = work(&pace)), &mut || {
            let _ = pace.ask(&go_on);
        });
        done
    }
}

/// A square matrix, column after column, of its packed lower triangle; zero above.
fn square(packed: &[f64], rows: usize) -> Vec<f64> {
    let mut all = vec![0.0; rows * rows];
    for (column, own) in columns(packed, rows).enumerate() {
        all[column * rows + column..(column + 1) * rows].copy_from_slice(own);
    }
    all
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::num::NonZero;
    use std::sync::{Arc, Mutex};

    use super::*;
    use crate::sparse::division::Division;
    use crate::sparse::selected::tests::{random_spd, seen_place};
    use crate::sparse::team::Team;
    use crate::sparse::{Abroad, Cholesky, Offer, selected_inverse, selected_sandwich};

    /// Others who take every branch but the first at once. What becomes of it is by its number.
    #[derive(Clone, Copy)]
    enum Others {
        Work,
        /// Every third is never heard of again, every other third comes back as something else.
        LoseAndSpoil,
    }

    struct Elsewhere {
        others: Others,
        done: Arc<Mutex<usize>>,
    }

    struct OnOffer {
        others: Others,
        asked: Mutex<Vec<usize>>,
        answers: Mutex<BTreeMap<usize, Answer>>,
        lost: Mutex<Vec<usize>>,
        done: Arc<Mutex<usize>>,
    }

    impl Abroad for Elsewhere {
        fn offer(&self, branches: usize) -> Option<Box<dyn Offer>> {
            Some(Box::new(OnOffer {
                others: self.others,
                asked: Mutex::new((1..branches).collect()),
                answers: Mutex::default(),
                lost: Mutex::default(),
                done: self.done.clone(),
            }))
        }
    }

    impl Offer for OnOffer {
        fn keep(&self, branch: usize) -> bool {
            branch == 0 || self.lost.lock().unwrap().contains(&branch)
        }

        fn wanted(&self) -> Vec<usize> {
            std::mem::take(&mut *self.asked.lock().unwrap())
        }

        fn send(&self, branch: usize, parcel: &Parcel) {
            let mut answer = parcel.work(&AtomicBool::new(false)).unwrap();
            match (self.others, branch % 3) {
                (Others::LoseAndSpoil, 0) => return self.lost.lock().unwrap().push(branch),
                (Others::LoseAndSpoil, 1) => drop(answer.values.pop()),
                _ => *self.done.lock().unwrap() += 1,
            }
            self.answers.lock().unwrap().insert(branch, answer);
        }

        fn answer(&self) -> Option<(usize, Answer)> {
            self.answers.lock().unwrap().pop_first()
        }

        fn goes_on(&self) -> bool {
            true
        }
    }

    #[test]
    fn branches_done_elsewhere_are_the_same_to_the_last_bit() {
        let pattern = seen_place();
        let (h, g) = (random_spd(&pattern, 5, 0.3), random_spd(&pattern, 105, 0.0));
        let all = |team: Team| {
            let mut cholesky = Cholesky::analyse(&pattern).unwrap().with_team(team);
            cholesky.factorise(&h).unwrap();
            let factor = cholesky.values().to_vec();
            let inverse = selected_inverse(&cholesky, &|_| true).unwrap();
            let (z, s) = selected_sandwich(&cholesky, &g, &|_| true).unwrap();
            (factor, [inverse, z, s].map(|own| own.values().to_vec()))
        };
        let expected = all(Team::alone());
        for (others, threads) in [(Others::Work, 1), (Others::Work, 2), (Others::LoseAndSpoil, 6)] {
            let done = Arc::new(Mutex::new(0));
            let team = Team::of(NonZero::new(threads).unwrap());
            let abroad = Arc::new(Elsewhere { others, done: done.clone() });
            assert!(all(team.and_abroad(abroad)) == expected);
            // Four passes; many threads have fine branches.
            let cholesky = Cholesky::analyse(&pattern).unwrap();
            let by_others = match others {
                Others::Work => 4 * (Division::coarse(cholesky.tree()).branches.len() - 1),
                Others::LoseAndSpoil => {
                    4 * (1..cholesky.division().branches.len()).filter(|branch| branch % 3 == 2).count()
                }
            };
            assert_eq!(*done.lock().unwrap(), by_others);
        }
    }

    #[test]
    fn a_pass_whose_branches_are_with_others_stops_when_told() {
        let pattern = seen_place();
        struct Silent;
        impl Abroad for Silent {
            fn offer(&self, _: usize) -> Option<Box<dyn Offer>> {
                Some(Box::new(Silent))
            }
        }
        impl Offer for Silent {
            fn keep(&self, _: usize) -> bool {
                false
            }
            fn wanted(&self) -> Vec<usize> {
                Vec::new()
            }
            fn send(&self, _: usize, _: &Parcel) {}
            fn answer(&self) -> Option<(usize, Answer)> {
                None
            }
            fn goes_on(&self) -> bool {
                true
            }
        }
        let mut cholesky = Cholesky::analyse(&pattern).unwrap();
        cholesky.factorise(&random_spd(&pattern, 5, 0.3)).unwrap();
        let cholesky = cholesky.with_team(Team::alone().and_abroad(Arc::new(Silent)));
        let begun = std::time::Instant::now();
        let until = |_: f64| begun.elapsed() < std::time::Duration::from_millis(300);
        assert_eq!(selected_inverse(&cholesky, &until).err(), Some(SparseError::Stopped));
    }

    /// A parcel of every kind.
    fn parcels() -> Vec<Parcel> {
        let kept = Arc::new(Mutex::new(Vec::new()));
        /// Asks for one branch, and lets the pass do it.
        struct Curious {
            kept: Arc<Mutex<Vec<Parcel>>>,
            sent: AtomicBool,
        }
        impl Abroad for Curious {
            fn offer(&self, _: usize) -> Option<Box<dyn Offer>> {
                Some(Box::new(Curious { kept: self.kept.clone(), sent: AtomicBool::new(false) }))
            }
        }
        impl Offer for Curious {
            fn keep(&self, branch: usize) -> bool {
                branch != 1 || self.sent.load(Ordering::Relaxed)
            }
            fn wanted(&self) -> Vec<usize> {
                if self.sent.load(Ordering::Relaxed) { Vec::new() } else { vec![1] }
            }
            fn send(&self, _: usize, parcel: &Parcel) {
                self.kept.lock().unwrap().push(parcel.clone());
                self.sent.store(true, Ordering::Relaxed);
            }
            fn answer(&self) -> Option<(usize, Answer)> {
                None
            }
            fn goes_on(&self) -> bool {
                true
            }
        }
        let pattern = seen_place();
        let (h, g) = (random_spd(&pattern, 5, 0.3), random_spd(&pattern, 105, 0.0));
        let abroad = Arc::new(Curious { kept: kept.clone(), sent: AtomicBool::new(false) });
        let mut cholesky = Cholesky::analyse(&pattern).unwrap().with_team(Team::alone().and_abroad(abroad));
        cholesky.factorise(&h).unwrap();
        selected_inverse(&cholesky, &|_| true).unwrap();
        selected_sandwich(&cholesky, &g, &|_| true).unwrap();
        kept.lock().unwrap().clone()
    }

    #[test]
    fn a_parcel_that_is_none_is_an_error() {
        let stop = AtomicBool::new(false);
        assert!(Parcel::default().work(&stop).is_err());
        let parcels = parcels();
        let kinds: std::collections::BTreeSet<_> =
            parcels.iter().map(|p| (p.matrices, p.factor.is_empty(), p.derivative.is_empty())).collect();
        assert_eq!(kinds.len(), 4, "{kinds:?}");
        for parcel in &parcels {
            assert!(parcel.work(&stop).is_ok());
            type Spoil = fn(&mut Parcel);
            let spoilt: [Spoil; 10] = [
                |p| p.begins.truncate(p.begins.len() - 1),
                |p| p.begins[1] = u32::MAX - 1,
                |p| p.row_starts.truncate(1),
                |p| p.row_starts[1] = u32::MAX,
                |p| p.rows[0] = 0,
                |p| p.rows.iter_mut().for_each(|row| *row += 1),
                |p| p.border += 1,
                |p| p.matrices = 9,
                |p| p.factor.push(0.0),
                |p| (p.places.push(u32::MAX), p.wanted.push(u32::MAX), p.entries.push(1.0)).0,
            ];
            for (k, spoil) in spoilt.into_iter().enumerate() {
                let mut other = parcel.clone();
                spoil(&mut other);
                // A longer border is no fault where nothing of it is given.
                let harmless = k == 6 && parcel.matrices == 0;
                assert!(harmless || matches!(other.work(&stop), Err(SparseError::Setup(_))), "{k}");
            }
        }
        // Told before it begins; what it says otherwise would fill a screen.
        assert_eq!(parcels[0].work(&AtomicBool::new(true)).err(), Some(SparseError::Stopped));
    }
}
