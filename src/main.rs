//! The command line; see [`mapfit::cli`].

fn main() -> std::process::ExitCode {
    mapfit::cli::main()
}
