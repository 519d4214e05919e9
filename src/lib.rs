pub mod fit;
pub mod geometry;
pub mod scan;
pub mod sim;
pub mod sparse;
pub mod spline;
pub mod uncertainty;
