//! What makes a Newton system positive definite, and its steps short enough to be believed.
//!
//! A step is taken with
//!
//! ```text
//! (1 - theta) H + theta H_convex + mu D
//! ```
//!
//! where `H` is the exact Hessian, `H_convex` its stand-in without negative curvature ([`Curvature`]), and `D` is
//! [`Objective::damping`](super::Objective::damping)'s matrix, which resists changes of slope everywhere.
//!
//! Near its minimum the robust Eikonal loss is markedly concave at ridges alone: `theta` damps there, turns returns a
//! little towards Gauss-Newton, and leaves all other places nearly their full Newton step, so it comes first. With `mu`
//! alone the worst ridge held up the whole building: in the house of `docs/calibration.md`, at half the noise, a fit
//! took 95 factorisations and now takes 76; in the hall with pillars, at five times the range noise, none converged and
//! now 88 of 100 do. The squared loss is concave wherever slopes are below one, which is nearly everywhere at the
//! start; there `mu` comes first. The stand-in's steps are longer, but end in higher minima (538 in place of 510 in the
//! L of `scripts/peers`).

use super::loss::Curvature;

/// Which damping comes first; see the module.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Law {
    /// `mu`, for the squared loss.
    Slopes,
    /// `theta`, for a robust one.
    Concavity,
    /// `theta` = 1 throughout: steps that are a way, not an end.
    Convex,
}

/// The damping of the step at hand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Damping {
    law: Law,
    /// `theta`.
    concavity: f64,
    /// `mu`.
    slopes: f64,
    /// What was too little of late; it is forgotten by and by.
    refused: f64,
}

/// What none rises to, and below which what has fallen is none: of `mu`, and of `theta`.
const LEAST_SLOPES: f64 = 1e-4;
const NO_SLOPES: f64 = 1e-7;
const LEAST_CONCAVITY: f64 = 0.03;
const NO_CONCAVITY: f64 = 1e-3;
/// The `mu` a fit starts with under [`Law::Slopes`]: enough for the squared Eikonal loss to be convex.
const FIRST_SLOPES: f64 = 1.0;
/// The `mu` from which the stand-in takes over under [`Law::Slopes`].
const CONVEX_FROM: f64 = 1e3;
/// A fit whose `mu` exceeds this cannot move: it has gone as far as rounding lets it.
const STUCK_FROM: f64 = 1e12;
/// By how much damping rises where the system is indefinite, falls after a good step, and by how much the memory of
/// damping that was too little fades a step. Tuned for the fewest factorisations: `mu`'s on 20 draws of experiment 1,
/// `theta`'s on 12 draws of seven cases of the study, where anything near will do.
const RAISE_SLOPES: f64 = 4.0;
const LOWER_SLOPES: f64 = 0.1;
const RAISE_CONCAVITY: f64 = 3.0;
const LOWER_CONCAVITY: f64 = 0.3;
const FORGET: f64 = 0.5;
/// How near to what was refused damping may fall.
const ABOVE_REFUSED: f64 = 1.5;

impl Damping {
    /// The damping of a first step.
    pub fn new(law: Law) -> Self {
        let (concavity, slopes) = if law == Law::Slopes { (0.0, FIRST_SLOPES) } else { (1.0, 0.0) };
        Self { law, concavity, slopes, refused: 0.0 }
    }

    /// The Hessian that goes with it.
    pub fn curvature(&self) -> Curvature {
        match self.law {
            Law::Slopes if self.slopes < CONVEX_FROM => Curvature::EXACT,
            Law::Slopes => Curvature::CONVEX,
            Law::Concavity | Law::Convex => Curvature::without_concavity(self.concavity),
        }
    }

    /// `mu`.
    pub fn slopes(&self) -> f64 {
        self.slopes
    }

    /// Whether steps have become too short to matter.
    pub fn is_stuck(&self) -> bool {
        self.slopes > STUCK_FROM
    }

    /// More of it: the system was indefinite.
    pub fn raise(&mut self) {
        if self.leads_by_concavity() {
            self.refused = self.concavity;
            self.harden(RAISE_CONCAVITY);
        } else {
            self.refused = if self.law == Law::Slopes { self.slopes } else { self.refused };
            self.harden(RAISE_SLOPES);
        }
    }

    /// Enough to leave a stationary point that is no minimum.
    pub fn restart(&mut self) {
        let first = Self::new(self.law);
        self.concavity = self.concavity.max(first.concavity);
        self.slopes = self.slopes.max(first.slopes);
    }

    /// Learns from a step of the given length, 0 where none lowered the objective, that kept so much of its promise.
    pub fn learn(&mut self, length: f64, kept: f64) {
        match (length, kept) {
            (0.0, _) => self.harden(16.0),
            (t, _) if t < 1.0 => self.harden((0.5 / t).clamp(1.0, 8.0)),
            (_, kept) if kept > 0.6 => self.ease(),
            (_, kept) if kept < 0.25 => self.harden(2.0),
            _ => {}
        }
        self.refused *= FORGET;
    }

    /// Whether there is concavity left to damp before slopes are.
    fn leads_by_concavity(&self) -> bool {
        self.law == Law::Concavity && self.concavity < 1.0
    }

    fn harden(&mut self, factor: f64) {
        if self.leads_by_concavity() {
            self.concavity = (self.concavity * factor).clamp(LEAST_CONCAVITY, 1.0);
        } else {
            self.slopes = (self.slopes * factor).max(LEAST_SLOPES);
        }
    }

    fn ease(&mut self) {
        let eased = |damping: f64, share: f64, refused: f64, none: f64| {
            let less = (damping * share).max(refused * ABOVE_REFUSED).min(damping);
            if less < none { 0.0 } else { less }
        };
        if self.law == Law::Concavity && self.slopes == 0.0 {
            self.concavity = eased(self.concavity, LOWER_CONCAVITY, self.refused, NO_CONCAVITY);
        } else {
            let refused = if self.law == Law::Slopes { self.refused } else { 0.0 };
            self.slopes = eased(self.slopes, LOWER_SLOPES, refused, NO_SLOPES);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LAWS: [Law; 3] = [Law::Slopes, Law::Concavity, Law::Convex];

    proptest! {
        #[test]
        fn whatever_happened_before_refusals_end_with_a_convex_system(
            law in prop::sample::select(&LAWS),
            steps in prop::collection::vec((prop::sample::select(&[0.0, 0.3, 1.0]), -1.0..3.0f64, 0..4usize), 0..40),
        ) {
            let mut damping = Damping::new(law);
            for (length, kept, refusals) in steps {
                (0..refusals).for_each(|_| damping.raise());
                damping.learn(length, kept);
            }
            let mut raised = 0;
            while !(damping.curvature() == Curvature::CONVEX && damping.slopes() > 0.0) && raised <= 16 {
                damping.raise();
                raised += 1;
            }
            prop_assert!(raised <= 16, "still not convex: {damping:?}");
        }
    }

    #[test]
    fn good_steps_end_with_the_exact_hessian_unless_the_law_is_convex() {
        for law in LAWS {
            let mut damping = Damping::new(law);
            (0..20).for_each(|_| damping.learn(1.0, 1.0));
            let expected = if law == Law::Convex { Curvature::CONVEX } else { Curvature::EXACT };
            assert_eq!((damping.curvature(), damping.slopes()), (expected, 0.0));
        }
    }

    #[test]
    fn a_saddle_is_left_with_a_convex_system() {
        for law in LAWS {
            let mut damping = Damping::new(law);
            (0..20).for_each(|_| damping.learn(1.0, 1.0));
            damping.restart();
            let convex =
                if law == Law::Slopes { damping.slopes() >= 1.0 } else { damping.curvature() == Curvature::CONVEX };
            assert!(convex, "{damping:?}");
        }
    }

    #[test]
    fn a_damping_that_only_rises_ends_stuck() {
        for law in LAWS {
            let mut damping = Damping::new(law);
            (0..64).for_each(|_| damping.raise());
            assert!(damping.is_stuck(), "{damping:?}");
        }
    }

    #[test]
    fn what_was_refused_is_not_tried_at_the_next_step() {
        let mut damping = Damping::new(Law::Concavity);
        (0..20).for_each(|_| damping.learn(1.0, 1.0));
        (0..3).for_each(|_| damping.raise());
        let (accepted, refused) = (damping.concavity, damping.refused);
        damping.learn(1.0, 1.0);
        assert!(damping.concavity > refused && damping.concavity <= accepted);
    }
}
