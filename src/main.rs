//! Arguments to subcommand; everything else is in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    plenalign::cli::main()
}
