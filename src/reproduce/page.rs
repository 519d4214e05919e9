//! The page that shows the figures and sets what was published beside what is measured.

use std::fmt::Write;

use super::{Compared, Plate, Reproduction, Table};

/// The page as Markdown; pictures are sought as `{folder}{name}.png`.
pub fn page(reproduction: &Reproduction, folder: &str) -> String {
    let mut text = String::from(
        "# The method's two experiments, reproduced\n\n\
         `mapfit reproduce --out DIR` draws this page, its figures (PNG and SVG) and its tables (CSV) from simulation, the same bytes \
         every time. The method: Arukgoda, Ranasinghe, Dantanarayana, Dissanayake, Furukawa, \"Representation of Uncertain Occupancy Maps with High \
         Level Feature Vectors\", CASE 2019. *Published* is its objective with its constants, with the printed slips corrected; *calibrated* is \
         ours, the default. What was published about a figure is put in our words.\n",
    );
    for table in &reproduction.tables {
        write_table(&mut text, table);
    }
    for plate in &reproduction.plates {
        write_plate(&mut text, plate, folder);
    }
    text
}

fn write_table(text: &mut String, Table { title, rows, .. }: &Table) {
    let _ = write!(text, "\n## {title}\n\n");
    for (k, row) in rows.iter().enumerate() {
        let _ = writeln!(text, "| {} |", row.join(" | "));
        if k == 0 {
            let _ = writeln!(text, "|{}", " --- |".repeat(row.len()));
        }
    }
}

fn write_plate(text: &mut String, plate: &Plate, folder: &str) {
    let Plate { name, title, caption, compared, .. } = plate;
    let number = name.trim_start_matches("figure-").trim_start_matches('0');
    let number = number.split('-').next().unwrap_or(number);
    let _ = write!(text, "\n## Figure {number}: {title}\n\n![{title}]({folder}{name}.png)\n\n{caption}\n\n");
    let _ = writeln!(text, "| published | measured here |\n| --- | --- |");
    for Compared { published, measured } in compared {
        let _ = writeln!(text, "| {published} | {measured} |");
    }
}
