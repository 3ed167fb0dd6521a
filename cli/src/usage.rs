//! Tips in errors about arguments: what an option of other programs is called here, what an option
//! is for, and examples.

use clap::CommandFactory;
use clap::error::{ContextKind, ContextValue, ErrorKind};

use super::Cli;

/// An option that corresponds to options of other programs.
struct Counterpart {
    /// Its names in other programs.
    others: &'static [&'static str],
    /// Its long name here; commands that lack it do not give the tip.
    option: &'static str,
    tip: &'static str,
}

const COUNTERPARTS: [Counterpart; 8] = [
    Counterpart {
        others: &["--camera", "--eye", "--lookat", "--target"],
        option: "position",
        tip: "--position, --look-at and --up place the camera, as do position, look_at and up of [camera] in TOML",
    },
    Counterpart {
        others: &["--angle", "--zoom", "--lens"],
        option: "fov",
        tip: "--fov gives the angle of view in degrees; a longer --focal distance or a smaller --film narrows it, too",
    },
    Counterpart {
        others: &["--width", "--height", "--resolution", "--res", "--geometry"],
        option: "size",
        tip: "--size 800x600 gives the size in pixels, --size 800x or x600 one side",
    },
    Counterpart {
        others: &["--spp", "--aa", "--antialias", "--antialiasing", "--supersample", "--msaa"],
        option: "samples",
        tip: "--samples 4 traces 4 x 4 rays through each pixel",
    },
    Counterpart {
        others: &["--gamma", "--colorspace", "--colourspace", "--tonemap"],
        option: "srgb",
        tip: "--srgb writes levels on the sRGB curve, and --exposure changes the brightness",
    },
    Counterpart {
        others: &["--format", "--type", "--png", "--ppm", "--exr"],
        option: "output",
        tip: "the extension of the file that -o names decides the format",
    },
    Counterpart {
        others: &["--lights", "--sun"],
        option: "light",
        tip: "--light gives a mesh or a molecule alone its lights; other scenes have theirs, as [[light]] in TOML",
    },
    Counterpart {
        others: &["--jobs", "--cores", "--cpus", "-j"],
        option: "threads",
        tip: "--threads 4 traces by four threads",
    },
];

/// An option of some commands that excludes other options.
struct Exclusive {
    commands: &'static [&'static str],
    option: &'static str,
    /// What the excluded options are for.
    tip: &'static str,
}

/// The commands that have the options of `view.rs`.
const OF_A_VIEW: &[&str] = &["render", "plan", "step", "convert"];

const EXCLUSIVE: [Exclusive; 20] = [
    Exclusive {
        commands: &["step"],
        option: "--op",
        tip: "--op takes --engine, --a and --b: --pixel, --precision, --lane, --steps and the options of the view belong to a \
              scene",
    },
    Exclusive {
        commands: &["step"],
        option: "--a",
        tip: "--a and --b belong to --op, which takes the place of a scene",
    },
    Exclusive {
        commands: &["step"],
        option: "--b",
        tip: "--a and --b belong to --op, which takes the place of a scene",
    },
    Exclusive {
        commands: &["step"],
        option: "--html",
        tip: "--depth and --only belong to text: a page has everything, and folds; --json prints a document in place of both",
    },
    Exclusive {
        commands: &["step"],
        option: "--json",
        tip: "--depth and --only belong to text: the document has everything",
    },
    Exclusive {
        commands: &["render"],
        option: "--orbit",
        tip: "--preview, --explain, --stats and --json belong to one picture, and --orbit writes several",
    },
    Exclusive {
        commands: &["experiment"],
        option: "--complexity",
        tip: "--ladder and --full belong to the paper's experiment: --complexity is measured instead, and prints its tables \
              anyway",
    },
    Exclusive {
        commands: &["experiment"],
        option: "--full",
        tip: "--full belongs to text: the document of --json has everything",
    },
    Exclusive {
        commands: &["ops"],
        option: "--proofs",
        tip: "--proofs is about all macros: --op, --engine, --asm, --executed, --markdown and --figure belong to \
              counts, --kernel and --kernels to listings",
    },
    Exclusive {
        commands: &["ops"],
        option: "--kernels",
        tip: "--kernels prints names and nothing else: --op, --engine, --asm, --executed, --markdown and --figure belong to \
              operations, and --kernel lists what it names",
    },
    Exclusive {
        commands: &["ops"],
        option: "--kernel",
        tip: "--kernel lists functions as they are: --op, --engine, --asm, --executed, --markdown and --figure belong to \
              operations",
    },
    Exclusive {
        commands: &["ops"],
        option: "--markdown",
        tip: "--markdown is the page of all operations: --op, --engine and --asm choose from them, and --json prints another \
              document",
    },
    Exclusive {
        commands: &["ops"],
        option: "--asm",
        tip: "--asm prints listings: --json and --figure belong to counts",
    },
    Exclusive {
        commands: OF_A_VIEW,
        option: "--fov",
        tip: "--fov and --film both say how wide the view is: --fov by its angle, --film by the film's diagonal",
    },
    Exclusive {
        commands: OF_A_VIEW,
        option: "--from",
        tip: "--from gives the side from which all is seen, and the distance is found; --position gives the camera's place",
    },
    Exclusive {
        commands: &["try"],
        option: "--truth",
        tip: "--op and --truth both say what the function is to compute: an operation of `rayo ops`, or a formula of your own",
    },
    Exclusive {
        commands: &["try"],
        option: "--template",
        tip: "--template prints a start for an --op, and tries nothing",
    },
    Exclusive {
        commands: &["try"],
        option: "--asm",
        tip: "--asm prints two listings and nothing else: --step shows one call, and the others belong to the verdict",
    },
    Exclusive {
        commands: &["try"],
        option: "--watch",
        tip: "--watch prints the table anew after each change of the files, and --json is one document",
    },
    Exclusive {
        commands: &["report"],
        option: "--from",
        tip: "--quick belongs to measuring, and --from measures nothing",
    },
];

/// The tip for two options of a command that exclude each other. The error names each with its
/// value, as in `--a <X,Y,Z>`; the first word is the option.
fn tip_of_exclusion(command: &str, error: &clap::Error) -> Option<&'static str> {
    let named = [ContextKind::InvalidArg, ContextKind::PriorArg].into_iter().filter_map(|kind| error.get(kind));
    let named: Vec<&str> = named
        .flat_map(|value| match value {
            ContextValue::String(name) => std::slice::from_ref(name),
            ContextValue::Strings(names) => names,
            _ => &[],
        })
        .filter_map(|name| name.split_whitespace().next())
        .collect();
    let is_meant = |exclusive: &&Exclusive| exclusive.commands.contains(&command) && named.contains(&exclusive.option);
    EXCLUSIVE.iter().find(is_meant).map(|exclusive| exclusive.tip)
}

/// Adds tips to clap's error about these arguments, of which the first is the name of the program.
pub fn add_tips(error: &mut clap::Error, mut arguments: impl Iterator<Item = String>) {
    let cli = Cli::command();
    let Some(command) = arguments.nth(1).and_then(|name| cli.find_subcommand(name).cloned()) else { return };
    match error.kind() {
        ErrorKind::UnknownArgument => {
            let Some(ContextValue::String(unknown)) = error.get(ContextKind::InvalidArg) else { return };
            let has = |option| command.get_arguments().any(|argument| argument.get_long() == Some(option));
            let counterpart =
                COUNTERPARTS.iter().find(|entry| entry.others.contains(&unknown.as_str()) && has(entry.option));
            if let Some(counterpart) = counterpart {
                error.remove(ContextKind::SuggestedArg);
                error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![counterpart.tip.into()]));
            }
        }
        ErrorKind::ArgumentConflict => {
            let Some(tip) = tip_of_exclusion(command.get_name(), error) else { return };
            error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
        }
        ErrorKind::MissingRequiredArgument => {
            let Some(examples) = command.get_after_help().map(ToString::to_string) else { return };
            let tip = examples.replacen("Examples:", "for example", 1).replace("\n  ", "\n       ");
            error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
        }
        _ => {}
    }
}
