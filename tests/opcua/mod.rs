//! The gateway for OPC UA against a client that is not ours: asyncua. What needs no client is in [`bare`].

mod bare;
mod client;
mod faults;
mod jobs;
mod states;

use crate::control::plan;
use crate::running::{Cell, PATIENCE, wait};
use client::Client;
use serde_json::{Value, json as value};
use std::collections::BTreeSet;
use std::io::{BufRead as _, BufReader};
use std::net::SocketAddr;
use std::process::{Child, Command, Stdio};

/// A name of a recipe with markup in it.
pub const MARKUP: &str = "<b>fail</b> & \"more\"";

/// A serving cell with the recipes `pass` and [`MARKUP`], or one that is not yet started, and its gateway.
pub struct Line {
    pub cell: Cell,
    pub run: Option<Child>,
    pub gateway: Child,
    pub address: SocketAddr,
}

impl Line {
    /// A cell that is ready, with a gateway that has found it.
    pub fn new(name: &str, rate_hz: f64, limits: &str) -> Self {
        let cell = recipes(Cell::played(name, rate_hz, limits));
        let run = cell.program("played.toml", &["--serve"]).stdout(Stdio::null()).spawn().unwrap();
        cell.until("ready", |status| status["state"] == "Ready");
        let (gateway, address) = gateway(&cell, &["--address", "127.0.0.1:0"]);
        Self { cell, run: Some(run), gateway, address }
    }

    /// A client that is connected.
    pub fn client(&self) -> Client {
        Client::connect(self.address)
    }

    pub fn ask(&self, request: &Value) -> Value {
        ask(&self.cell, request)
    }

    /// Kills the gateway, as a crash does, and starts another one at the same address.
    pub fn replace_gateway(&mut self) {
        self.gateway.kill().unwrap();
        self.gateway.wait().unwrap();
        let address = self.address.to_string();
        (self.gateway, self.address) = gateway(&self.cell, &["--address", &address]);
    }

    pub fn stop(mut self) {
        self.gateway.kill().unwrap();
        self.gateway.wait().unwrap();
        if let Some(run) = self.run.take() {
            self.ask(&value!({"command": "stop"}));
            wait(run);
        }
    }
}

/// A test that fails leaves neither cell nor gateway behind.
impl Drop for Line {
    fn drop(&mut self) {
        for process in [Some(&mut self.gateway), self.run.as_mut()].into_iter().flatten() {
            let _ = process.kill();
            let _ = process.wait();
        }
    }
}

/// One request over the command socket.
pub fn ask(cell: &Cell, request: &Value) -> Value {
    use std::io::Write as _;
    let socket = ipc::cell::CellName::new(&cell.name).unwrap().socket();
    let mut stream = std::os::unix::net::UnixStream::connect(socket).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    writeln!(stream, "{request}").unwrap();
    let mut line = String::new();
    BufReader::new(stream).read_line(&mut line).unwrap();
    serde_json::from_str(&line).unwrap_or_else(|e| panic!("{e}: {line:?}"))
}

/// Adds the recipes to a played cell.
pub fn recipes(cell: Cell) -> Cell {
    std::fs::write(cell.small.path("pass.plan.toml"), plan(-50.0, 50.0)).unwrap();
    std::fs::write(cell.small.path("fail.plan.toml"), plan(40.0, 50.0)).unwrap();
    let name = toml::Value::from(MARKUP);
    let recipes = format!(
        "[[recipe]]\nname = \"pass\"\nplan = \"pass.plan.toml\"\n[[recipe]]\nname = {name}\nplan = \"fail.plan.toml\"\n[limits]\n"
    );
    cell.small.edit("played.toml", "[limits]\n", &recipes);
    cell
}

/// A gateway and the address that it prints.
pub fn gateway(cell: &Cell, more: &[&str]) -> (Child, SocketAddr) {
    let mut program = Command::new(env!("CARGO_BIN_EXE_fringecell"));
    program.args(["opcua", &cell.small.path("played.toml"), "--cell", &cell.name]).args(more);
    let mut gateway = program.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(gateway.stdout.as_mut().unwrap()).read_line(&mut line).unwrap();
    let address = line.trim().strip_prefix("OPC UA at opc.tcp://").unwrap_or_else(|| panic!("{line:?}"));
    (gateway, address.parse().unwrap())
}

/// The published nodeset, as text.
pub fn nodeset() -> String {
    let path = "processes/gateway/nodeset/Opc.Ua.MachineVision.NodeSet2.xml";
    std::fs::read_to_string(crate::support::root().join(path)).unwrap()
}

/// Proves: every node of the published nodeset is there, with its class, name, data type, rank and type definition.
#[test]
#[cfg_attr(
    not(asyncua),
    ignore = "needs asyncua: pip install asyncua==2.1.0, then cargo test --features opcua --test main opcua"
)]
fn every_node_of_the_nodeset_is_there_with_its_type() {
    let line = Line::new("opcnodes", 0.0, "");
    let mut client = line.client();
    let text = nodeset();
    let document = roxmltree::Document::parse(&text).unwrap();
    let number = |id: &str| id.strip_prefix("ns=1;i=").map(|number| number.parse::<u32>().unwrap());
    let nodes: Vec<(u32, roxmltree::Node)> = document
        .root_element()
        .children()
        .filter_map(|node| Some((number(node.attribute("NodeId")?)?, node)))
        .collect();
    assert_eq!(nodes.len(), 790);
    let ids: Vec<u32> = nodes.iter().map(|(id, _)| *id).collect();
    let found = client.ask("nodes", &value!({"ids": ids}));
    let standard = client.standard;
    let alias = |name: &str| {
        let aliases = document
            .descendants()
            .filter(|node| node.has_tag_name(("http://opcfoundation.org/UA/2011/03/UANodeSet.xsd", "Alias")));
        let mut known = aliases.filter(|node| node.attribute("Alias") == Some(name));
        let id = known.find_map(|node| node.text()).unwrap_or(name).to_owned();
        id.strip_prefix("ns=1;").map_or(id.clone(), |rest| format!("ns={standard};{rest}"))
    };
    for (id, node) in &nodes {
        let told = &found[id.to_string()];
        let class = node.tag_name().name().strip_prefix("UA").unwrap();
        assert_eq!(told["class"], class, "{id}");
        let name = node.attribute("BrowseName").unwrap();
        let (namespace, name) = name.strip_prefix("1:").map_or((0, name), |name| (standard, name));
        assert_eq!((&told["name"], &told["namespace"]), (&name.into(), &namespace.into()), "{id}");
        if class == "Variable" {
            assert_eq!(told["data_type"], alias(node.attribute("DataType").unwrap_or("i=24")), "{id}");
            let rank: i64 = node.attribute("ValueRank").map_or(-1, |rank| rank.parse().unwrap());
            assert_eq!(told["rank"], rank, "{id}");
        }
        let mut references =
            node.descendants().filter(|node| node.attribute("ReferenceType") == Some("HasTypeDefinition"));
        let type_id = references.find_map(|node| node.text()).map(alias);
        assert_eq!(told["type"].as_str(), type_id.as_deref(), "{id}");
    }
    line.stop();
}

/// Proves: the cell is an instance of the types, with all that is mandatory, and nothing else than what is documented.
#[test]
#[cfg_attr(
    not(asyncua),
    ignore = "needs asyncua: pip install asyncua==2.1.0, then cargo test --features opcua --test main opcua"
)]
fn the_cell_has_the_members_of_its_type() {
    let line = Line::new("opcbrowse", 0.0, "");
    let mut client = line.client();
    let browsed = client.ask("browse", &value!({}));
    let name = &line.cell.name;
    let paths: BTreeSet<&str> = browsed
        .as_object()
        .unwrap()
        .keys()
        .filter_map(|path| path.strip_prefix(&format!("{name}/")))
        .collect();
    let machine = "VisionStateMachine";
    let automatic = "VisionStateMachine/AutomaticModeStateMachine";
    for (object, members) in [
        (
            machine,
            vec![
                "CurrentState",
                "CurrentState/Id",
                "Halt",
                "Reset",
                "SelectModeAutomatic",
                "Operational/StateNumber",
            ],
        ),
        (
            automatic,
            vec!["CurrentState", "StartSingleJob", "StartContinuous", "Stop", "Abort", "Stop/InputArguments"],
        ),
        (
            "RecipeManagement",
            vec!["PrepareRecipe", "UnprepareRecipe", "GetRecipeListFiltered", "Recipes/pass/IsPrepared"],
        ),
        (
            "ResultManagement",
            vec!["GetResultById", "GetResultComponentsById", "GetResultListFiltered", "Results"],
        ),
        (
            "ConfigurationManagement",
            vec!["ActiveConfiguration", "GetConfigurationList", "ActivateConfiguration"],
        ),
    ] {
        for member in members {
            assert!(paths.contains(format!("{object}/{member}").as_str()), "{object}/{member}: {paths:#?}");
        }
    }
    assert!(paths.contains(format!("RecipeManagement/Recipes/{MARKUP}/Prepare").as_str()));
    let standard = client.standard;
    assert_eq!(browsed[name.as_str()], format!("ns={standard};i=1003"));
    assert_eq!(browsed[format!("{name}/{automatic}")], format!("ns={standard};i=1021"));
    assert!(
        !paths.iter().any(|path| path.contains('<') && !path.contains(MARKUP)),
        "a placeholder is no node"
    );
    let state = client.ask("read", &value!({"path": format!("{machine}/CurrentState/Id")}));
    assert_eq!(state["value"], format!("ns={standard};i=5031"));
    let recipe = client.ask("read", &value!({"path": "RecipeManagement/Recipes/1/InternalId"}));
    assert_eq!(recipe["value"]["Id"], MARKUP);
    line.stop();
}
