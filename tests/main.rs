//! Integration tests, all through the real binaries and real files. Table of contents:
//!
//! - [`offline`]: the twin's frames become a cloud whose features are true
//! - [`real`]: recordings by other people's cameras
//! - [`bad_input`]: whatever is wrong with the input, a message and exit code 2
//! - [`calibrate`]: real images of boards become a rig file
//! - [`calibrate_bad`]: images and targets that cannot be used end in one line and no file
//! - [`charuco`]: boards with markers, whole and in part
//! - [`point_lists`]: calibrations from points that others found, lens models, frames of a video
//! - [`focus`]: best focus and depth of focus from images of a checkerboard
//! - [`gamma`]: a projector's response is measured and corrected
//! - [`compare`]: deviations that are known beforehand
//! - [`register`]: motions that are known beforehand
//! - [`cad`]: CAD in STEP as reference and as source of a plan
//! - [`pose`]: where a part lies is found from anywhere, or refused
//! - [`rig_state`]: a rig file against what its cameras see, and against other programs
//! - [`adversity`]: no memory, a full disk, a closed output, another cell on the same machine
//! - [`lost_places`]: no shared memory, none left, outputs of a run that cannot be written
//! - [`limits`]: files that promise more than fits, memory and threads that are not there
//! - [`other_user`]: another user of the machine; no processes, no file descriptors, no readers
//! - [`every_command`]: standard output of every command: pure JSON, or an error when it is lost
//! - [`panics`]: a panic in any process is an outcome
//! - [`hung_disk`]: a disk that does not answer
//! - [`cell`]: a running cell: results, outcomes, kills, stops
//! - `allocations`: what warm stages do not do; only with the feature `count-allocations`
//! - [`conformance`]: drivers through the checks that every driver has to pass
//! - [`control`]: a cell that takes jobs: states, recipes, refusals, metrics
//! - [`control_page`]: the requests of `docs/control.md` against a cell
//! - [`uncertainty`]: budgets in, table, JSON and report out
//! - [`acceptance_report`]: every format from one result of an acceptance test
//! - [`lightcrafter`]: projector boards: an emulated one gives the bytes of the twin, and its faults are told
//! - [`lights`]: how the tests of projectors make cells and tell the twin what is shown
//! - [`screen`]: projectors that are screens: every pixel read back from a virtual display
//! - [`gige`]: cameras on the network give the bytes of the twin, and losses are repaired or told
//! - [`golden_cells`]: the printed cells of the thesis' tables, recomputed
//! - [`acceptance`]: acceptance tests from their plans
//! - [`fits`]: elements, inspection plans and comparisons with a coordinate measuring machine
//! - [`proof`]: the same bytes whatever the timing, and nothing that grows
//! - [`storm`]: one outcome per cycle and no wrong cloud, whatever stage dies, hangs or sends invalid messages
//! - [`one_flow`]: a cell and the offline tools give the same cloud of the same frames
//! - [`overwrite`]: outputs that would destroy an input or a file of another kind
//! - [`changed_files`]: configuration, rig, plan, recording and frames that change under a running cell
//! - [`run_folder`]: the output folder of a run: earlier runs, two cells, killed runs, parts of a serving cell
//! - [`record`]: cycle records, replays, and what a crash or a full disk leaves of them
//! - [`schemas`]: what the programs write as JSON against `docs/schemas`; [`schema`] is the check
//! - `opcua`: the gateway for OPC UA against a client that is not ours; only with the feature `opcua`
//! - [`running`]: how the tests run a cell and harm it
//! - [`page`]: the live page over HTTP: content, refusals, many viewers, kills; and in a browser where there is one
//! - [`plan_patterns`]: what a plan of patterns promises against what its recording gives
//! - [`documented_commands`]: every command of README and `docs/`, page by page
//! - [`examples`]: the programs in `examples/` on small inputs
//! - [`documentation`]: README and pages: lengths, links, commands and options that exist
//! - [`file_formats`]: the keys of `docs/formats.md` against the parsers
//! - [`twin_settings`]: settings of the twin in a configuration and on the command line: what is refused, and how it is said
//! - [`codecs`]: every way of coding the projector's coordinate: sigma beside scatter, points beside a plane, refusals
//! - [`dirt`]: recordings with faulty or missing frames, and clean ones
//! - [`explore`]: sequences found in recordings by others, and what is proposed of them
//! - [`service`]: what a service manager hears, the unit, the Debian package
//! - [`several_hosts`]: a cell on several computers gives the hashes of one, and every loss is an outcome
//! - [`single_view`]: one camera and projector: unwrapping, filters, reference planes, a rotation stage
//! - [`words`]: doc comments, help texts and option names in standard words; former option names
//! - [`support`]: how the tests run programs and make small recordings

mod acceptance;
mod acceptance_report;
mod adversity;
#[cfg(feature = "count-allocations")]
mod allocations;
mod bad_input;
mod cad;
mod calibrate;
mod calibrate_bad;
mod calibration_shares;
mod cell;
mod changed_files;
mod charuco;
mod codecs;
mod compare;
mod conformance;
mod control;
mod control_page;
mod dirt;
mod documentation;
mod documented_commands;
mod every_command;
mod examples;
mod explore;
mod file_formats;
mod fits;
mod focus;
mod gamma;
mod gige;
mod golden_cells;
mod hung_disk;
mod lightcrafter;
mod lights;
mod limits;
mod lost_places;
mod oblique;
mod offline;
mod one_flow;
#[cfg(feature = "opcua")]
mod opcua;
mod other_user;
mod overwrite;
mod page;
mod panics;
mod phase_methods;
mod plan_patterns;
mod plan_views;
mod point_lists;
mod pose;
mod proof;
mod quadrants;
mod quadrants_calibration;
mod real;
mod record;
mod register;
mod rig_state;
mod run_folder;
mod running;
mod schema;
mod schemas;
mod screen;
mod service;
mod several_hosts;
mod single_view;
mod spc;
mod storm;
mod support;
mod together;
mod twin_settings;
mod uncertainty;
mod words;
