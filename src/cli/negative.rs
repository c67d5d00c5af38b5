//! Negative numbers as values of flags.

/// Lets flags take negative numbers, so that a range is refused by its own sentence.
pub(super) fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let names: Vec<String> = command.get_subcommands().map(|sub| sub.get_name().to_owned()).collect();
    let command = command.mut_args(|flag| match flag.get_action().takes_values() && !flag.is_positional() {
        true => flag.allow_negative_numbers(true),
        false => flag,
    });
    names.iter().fold(command, |command, name| command.mut_subcommand(name, with_negative_numbers))
}
