//! The methods of the specification, each of which becomes a request to the cell or is answered from what the gateway knows.

use super::arguments::Arguments;
use super::link::Link;
use super::machine::state;
use super::names::{JobNames, internal_recipe, structure};
use super::types::{JobId, MeasId, PartId, ProductId, RecipeIdExternal, RecipeIdInternal};
use super::vision::Vision;
use crate::supervisor::protocol::{Answer, Request};
use opcua::sync::Mutex;
use opcua::types::{StatusCode, UaNullable, Variant};
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::atomic::AtomicU32;
use std::time::Duration;

/// Values of the output `Error`; 0 is done. They are documented in `docs/opcua.md`.
pub(super) mod error {
    pub const REFUSED: i32 = 1;
    pub const UNKNOWN_RECIPE: i32 = 2;
    pub const NOT_PREPARED: i32 = 3;
    pub const IN_USE: i32 = 4;
    pub const UNKNOWN_RESULT: i32 = 5;
    pub const PARAMETERS: i32 = 6;
    pub const UNKNOWN_CONFIGURATION: i32 = 7;
    pub const UNKNOWN_HANDLE: i32 = 8;
    pub const NOT_READY: i32 = 9;
}

/// Longest wait of `SelectModeAutomatic` for stages that start.
const AUTOMATIC_PATIENCE: Duration = Duration::from_secs(5);

/// Longest wait of a method until the nodes show what it did.
const SHOWN_PATIENCE: Duration = Duration::from_secs(2);

/// Part of a job whose client named none.
const UNNAMED: &str = "unnamed";

/// How a call ends.
pub enum Reply {
    /// Well, with its output arguments.
    Done(Vec<Variant>),
    /// With a status and nothing else.
    Bad(StatusCode),
    /// With a status for each argument.
    Wrong(Vec<StatusCode>),
}

impl From<StatusCode> for Reply {
    fn from(status: StatusCode) -> Self {
        Self::Bad(status)
    }
}

impl From<Vec<StatusCode>> for Reply {
    fn from(results: Vec<StatusCode>) -> Self {
        Self::Wrong(results)
    }
}

pub(super) type Called = Result<Vec<Variant>, Reply>;

/// What the methods need.
pub struct Methods {
    /// State, results and events of the cell.
    pub vision: Mutex<Vision>,
    socket: PathBuf,
    pub(super) next_handle: AtomicU32,
    pub(super) handles: Mutex<VecDeque<u32>>,
}

impl Methods {
    /// For the cell behind a socket.
    pub fn new(vision: Vision, socket: PathBuf) -> Self {
        Self {
            vision: Mutex::new(vision),
            socket,
            next_handle: AtomicU32::new(1),
            handles: Mutex::new(VecDeque::new()),
        }
    }

    /// Calls a method by its path below the vision system.
    pub async fn call(&self, path: &str, arguments: &[Variant]) -> Reply {
        let called = match path.rsplit('/').next().unwrap_or_default() {
            "StartSingleJob" => self.start(arguments, true).await,
            "StartContinuous" => self.start(arguments, false).await,
            "Stop" => self.command("Stop", Request::Finish {}, arguments).await,
            "Abort" => self.command("Abort", Request::Abort {}, arguments).await,
            "Halt" => self.command("Halt", Request::Halt {}, arguments).await,
            "Reset" => self.command("Reset", Request::Reset {}, arguments).await,
            "SelectModeAutomatic" => self.select_automatic().await,
            "PrepareRecipe" => self.prepare_recipe(arguments, true).await,
            "UnprepareRecipe" => self.prepare_recipe(arguments, false).await,
            "Prepare" => self.prepare_node(path, true).await,
            "Unprepare" => self.prepare_node(path, false).await,
            "GetRecipeListFiltered" => self.recipes(arguments),
            "GetResultById" => self.result(arguments),
            "GetResultComponentsById" => self.components(arguments),
            "GetResultListFiltered" => self.results(arguments),
            "GetConfigurationById" => self.configuration(arguments),
            "GetConfigurationList" => self.configurations(arguments),
            "ActivateConfiguration" => self.activate(arguments),
            "ReleaseResultHandle" | "ReleaseRecipeHandle" | "ReleaseConfigurationHandle" => {
                self.release(arguments)
            }
            _ => Err(Reply::Bad(StatusCode::BadNotImplemented)),
        };
        called.map_or_else(|reply| reply, Reply::Done)
    }

    /// Refuses a method that the state does not permit.
    fn permit(&self, method: &str) -> Result<(), Reply> {
        match self.vision.lock().permits(method) {
            Some(true) => Ok(()),
            Some(false) => Err(Reply::Bad(StatusCode::BadInvalidState)),
            None => Err(Reply::Bad(StatusCode::BadNoCommunication)),
        }
    }

    /// Sends a request to the cell.
    async fn ask(&self, request: &Request) -> Result<Answer, Reply> {
        let asked = async { Link::open(&self.socket).await?.ask(request).await };
        asked.await.map_err(|error| {
            tracing::warn!("{error:#}");
            Reply::Bad(StatusCode::BadNoCommunication)
        })
    }

    /// Sends a request that changes the state: which method caused the change is known before it comes.
    async fn change(&self, method: &'static str, request: &Request) -> Result<Result<Answer, i32>, Reply> {
        self.vision.lock().cause = Some(method);
        let answer = self.ask(request).await;
        let refused = |error: i32| {
            self.vision.lock().cause = None;
            error
        };
        match answer {
            Err(reply) => {
                refused(0);
                Err(reply)
            }
            Ok(Answer::NotReady { .. }) => {
                refused(0);
                Err(Reply::Bad(StatusCode::BadInvalidState))
            }
            Ok(Answer::Refused(reason)) => {
                tracing::info!("{method}: {reason}");
                refused(0);
                code(&reason).map(Err)
            }
            Ok(answer) => Ok(Ok(answer)),
        }
    }

    async fn start(&self, arguments: &[Variant], single: bool) -> Called {
        let mut read = Arguments::new(arguments, 5)?;
        let (meas, part): (MeasId, PartId) = (read.structure(), read.structure());
        let (recipe, product): (RecipeIdExternal, ProductId) = (read.structure(), read.structure());
        let parameters = read.array_length();
        read.check()?;
        let method = if single { "StartSingleJob" } else { "StartContinuous" };
        self.permit(method)?;
        let failed = |error: i32| Ok(vec![structure(JobId::default()), error.into()]);
        if parameters > 0 {
            return failed(error::PARAMETERS);
        }
        if !is_plain(recipe.version.as_ref(), recipe.hash.as_ref()) {
            return failed(error::UNKNOWN_RECIPE);
        }
        let given = part.id.as_ref().to_owned();
        let name = if given.is_empty() { UNNAMED.to_owned() } else { given.clone() };
        let recipe = Some(recipe.id.as_ref().to_owned()).filter(|id| !id.is_empty());
        let request = Request::Begin { part: single.then_some(name), recipe };
        match self.change(method, &request).await? {
            Ok(Answer::Begun { job }) => {
                let names = JobNames {
                    meas: meas.id.as_ref().to_owned(),
                    part: given,
                    product: product.id.as_ref().to_owned(),
                };
                let id = {
                    let mut vision = self.vision.lock();
                    vision.name_job(job, names);
                    vision.job_id(job)
                };
                self.catch_up().await;
                Ok(vec![structure(id), 0.into()])
            }
            Ok(_) => failed(error::REFUSED),
            Err(error) => failed(error),
        }
    }

    async fn command(&self, method: &'static str, request: Request, arguments: &[Variant]) -> Called {
        let mut read = Arguments::new(arguments, 2)?;
        let (cause, description) = (read.int32(), read.text());
        read.check()?;
        self.permit(method)?;
        tracing::info!(cause, description, "{method}");
        let error = self.change(method, &request).await?.err().unwrap_or(0);
        self.catch_up().await;
        Ok(vec![error.into()])
    }

    /// The cell becomes operational by itself once its stages are ready.
    async fn select_automatic(&self) -> Called {
        self.permit("SelectModeAutomatic")?;
        self.vision.lock().cause = Some("SelectModeAutomatic");
        let operational = async {
            while self.vision.lock().position().is_none_or(|at| at.system != state::OPERATIONAL) {
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        };
        let error = match tokio::time::timeout(AUTOMATIC_PATIENCE, operational).await {
            Ok(()) => 0,
            Err(_) => error::NOT_READY,
        };
        Ok(vec![error.into()])
    }

    async fn prepare_recipe(&self, arguments: &[Variant], prepare: bool) -> Called {
        let mut read = Arguments::new(arguments, 2)?;
        let (external, internal): (RecipeIdExternal, RecipeIdInternal) = (read.structure(), read.structure());
        read.check()?;
        let name = if internal.id.is_empty() { external.id.clone() } else { internal.id.clone() };
        let plain = is_plain(external.version.as_ref(), external.hash.as_ref())
            && is_plain(internal.version.as_ref(), internal.hash.as_ref());
        let agree = internal.id.is_empty() || external.id.is_empty() || internal.id == external.id;
        let error =
            if plain && agree { self.prepare(name.as_ref(), prepare).await? } else { error::UNKNOWN_RECIPE };
        Ok(if prepare {
            vec![structure(internal_recipe(name.as_ref())), (error == 0).into(), error.into()]
        } else {
            vec![structure(internal_recipe(name.as_ref())), error.into()]
        })
    }

    /// Prepares the recipe whose node has the method.
    async fn prepare_node(&self, path: &str, prepare: bool) -> Called {
        let index: Option<usize> = path.rsplit('/').nth(1).and_then(|text| text.parse().ok());
        let name = {
            let vision = self.vision.lock();
            let report = vision.reached().ok_or(Reply::Bad(StatusCode::BadNoCommunication))?;
            let recipe = index.and_then(|index| report.recipes.get(index));
            recipe.ok_or(Reply::Bad(StatusCode::BadNodeIdUnknown))?.name.clone()
        };
        let error = self.prepare(&name, prepare).await?;
        Ok(if prepare { vec![(error == 0).into(), error.into()] } else { vec![error.into()] })
    }

    async fn prepare(&self, name: &str, prepare: bool) -> Result<i32, Reply> {
        let recipe = name.to_owned();
        let (method, request) = if prepare {
            ("PrepareRecipe", Request::Prepare { recipe })
        } else {
            ("UnprepareRecipe", Request::Unprepare { recipe })
        };
        let error = self.change(method, &request).await?.err().unwrap_or(0);
        self.catch_up().await;
        Ok(error)
    }

    /// Waits until the nodes show all that the cell has done so far: who asks after a method sees what it did.
    async fn catch_up(&self) {
        let news = self.vision.lock().news(false);
        let Ok(Answer::Watched(now)) = self.ask(&news).await else { return };
        let shown = async {
            while !self.vision.lock().shows(&now.run, now.newest) {
                tokio::time::sleep(Duration::from_millis(1)).await;
            }
        };
        if tokio::time::timeout(SHOWN_PATIENCE, shown).await.is_err() {
            tracing::warn!("change {} of the cell is not shown yet", now.newest);
        }
    }
}

/// Whether an identification names neither a version nor a content, of which the cell has none.
fn is_plain(version: Option<&opcua::types::UAString>, hash: Option<&opcua::types::ByteString>) -> bool {
    version.is_none_or(opcua::types::UAString::is_empty) && hash.is_none_or(UaNullable::is_ua_null)
}

/// What the cell's refusal means: a state that does not allow it, or an error of the request.
fn code(reason: &str) -> Result<i32, Reply> {
    if reason.contains("the recipe is not prepared") {
        Ok(error::NOT_PREPARED)
    } else if reason.contains("the running job uses the recipe") {
        Ok(error::IN_USE)
    } else if reason.starts_with("no recipe ") {
        Ok(error::UNKNOWN_RECIPE)
    } else if [
        "Preoperational",
        "Initialized",
        "Ready",
        "SingleExecution",
        "ContinuousExecution",
        "Halted",
        "Error",
    ]
    .iter()
    .any(|state| reason.strip_prefix(state).is_some_and(|rest| rest.starts_with(": ")))
    {
        Err(Reply::Bad(StatusCode::BadInvalidState))
    } else {
        Ok(error::REFUSED)
    }
}
