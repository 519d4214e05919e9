//! The command line; see [`mapfit::cli`].

/// Returns to the system what is not in use. glibc's keeps a heap for every thread that ever computed: a gigabyte after
/// some thousand small jobs.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> std::process::ExitCode {
    mapfit::cli::main()
}
