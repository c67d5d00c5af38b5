//! x
/// x
#[derive(Debug, clap::Args)]
pub struct Arguments {}
/// x
pub fn run(_: &Arguments) -> Result<(), super::Failure> {
    Ok(())
}
