//! Who may connect: addresses, policies, users. Without further options only this machine, without a user.

use crate::gateway_arguments::GatewayArgs;
use anyhow::{Context as _, Result, bail};
use ipc::cell::CellName;
use opcua::crypto::SecurityPolicy;
use opcua::server::{ANONYMOUS_USER_TOKEN_ID, ServerBuilder, ServerEndpoint, ServerUserToken};
use opcua::types::{BuildInfo, DateTime, MessageSecurityMode};
use std::net::SocketAddr;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

/// Policies with certificates; older ones are broken.
const POLICIES: [SecurityPolicy; 3] =
    [SecurityPolicy::Basic256Sha256, SecurityPolicy::Aes128Sha256RsaOaep, SecurityPolicy::Aes256Sha256RsaPss];

/// Largest message in each direction, bytes, and its pieces of 64 kB.
const MESSAGE: (usize, usize) = (8 << 20, 160);

/// Who may connect, and how.
pub struct Access {
    users: Vec<(String, String)>,
    anonymous: bool,
    pki: Option<PathBuf>,
    /// Stands in for a folder of certificates, which the library wants in any case.
    unused: tempfile::TempDir,
}

impl Access {
    /// Checks the options.
    ///
    /// # Errors
    /// An address that other machines can reach, without protection; a file that cannot be used.
    pub fn new(args: &GatewayArgs) -> Result<Self> {
        let (address, remote) = (args.address, !args.address.ip().is_loopback());
        if remote && args.pki.is_none() {
            bail!(
                "--address {address}: other machines can reach this address; add --pki DIR, or use 127.0.0.1"
            );
        }
        if remote && args.users.is_none() && !args.allow_anonymous {
            bail!(
                "--address {address}: other machines can reach this address; add --users FILE or --allow-anonymous, or use \
                 127.0.0.1"
            );
        }
        if let Some(folder) = &args.pki {
            files::atomic::create_dir(folder)?;
        }
        let users = args.users.as_deref().map(read_users).transpose()?.unwrap_or_default();
        let anonymous = args.allow_anonymous || (!remote && args.users.is_none());
        let unused = tempfile::tempdir().context("a folder for temporary files")?;
        Ok(Self { users, anonymous, pki: args.pki.clone(), unused })
    }

    /// Applies the rules to a server.
    pub fn configure(&self, builder: ServerBuilder, cell: &CellName, address: SocketAddr) -> ServerBuilder {
        let version = env!("CARGO_PKG_VERSION");
        let uri = format!("urn:fringecell:{}", cell.as_str());
        let mut tokens: Vec<String> = self.users.iter().map(|(name, _)| name.clone()).collect();
        if self.anonymous {
            tokens.push(ANONYMOUS_USER_TOKEN_ID.to_owned());
        }
        let mut builder = builder
            .application_name(format!("fringecell {}", cell.as_str()))
            .application_uri(&uri)
            .product_uri("urn:fringecell")
            .build_info(BuildInfo {
                product_uri: "urn:fringecell".into(),
                manufacturer_name: "fringecell".into(),
                product_name: "fringecell".into(),
                software_version: version.into(),
                build_number: env!("FRINGECELL_COMMIT").into(),
                build_date: DateTime::null(),
            })
            .host(address.ip().to_string())
            .port(address.port())
            .pki_dir(self.pki.as_deref().unwrap_or(self.unused.path()))
            .create_sample_keypair(self.pki.is_some())
            .diagnostics_enabled(false)
            .max_message_size(MESSAGE.0)
            .max_chunk_count(MESSAGE.1)
            .max_string_length(MESSAGE.0)
            .max_sessions(32)
            .discovery_urls(vec![format!("opc.tcp://{address}/")]);
        let limits = &mut builder.limits_mut().subscriptions;
        limits.max_queued_notifications = 1000;
        limits.max_monitored_item_queue_size = 1000;
        for (name, password) in &self.users {
            builder = builder.add_user_token(name, ServerUserToken::user_pass(name, password));
        }
        let endpoint = |policy, mode| ServerEndpoint::new("/", policy, mode, &tokens);
        if address.ip().is_loopback() {
            let plain = endpoint(SecurityPolicy::None, MessageSecurityMode::None);
            builder = builder.add_endpoint("none", plain);
        }
        for policy in POLICIES.into_iter().filter(|_| self.pki.is_some()) {
            for mode in [MessageSecurityMode::Sign, MessageSecurityMode::SignAndEncrypt] {
                builder = builder.add_endpoint(format!("{policy} {mode}"), endpoint(policy, mode));
            }
        }
        builder
    }
}

/// Reads names and passwords.
fn read_users(file: &Path) -> Result<Vec<(String, String)>> {
    let shown = file.display();
    let text =
        std::fs::read_to_string(file).with_context(|| format!("--users {shown}: cannot read this file"))?;
    let mode = std::fs::metadata(file).map_or(0, |data| data.permissions().mode() & 0o777);
    if mode & 0o077 != 0 {
        bail!("--users {shown}: others may read this file (mode {mode:o}); `chmod 600 {shown}`");
    }
    let mut users: Vec<(String, String)> = Vec::new();
    for (number, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let number = number + 1;
        let mut words = line.split_whitespace();
        let (Some(name), Some(password), None) = (words.next(), words.next(), words.next()) else {
            bail!("--users {shown}:{number}: a line has a name and a password, apart by a space");
        };
        if name == ANONYMOUS_USER_TOKEN_ID || users.iter().any(|(known, _)| known == name) {
            bail!("--users {shown}:{number}: the name {name} is taken; give each user a name of their own");
        }
        users.push((name.to_owned(), password.to_owned()));
    }
    if users.is_empty() {
        bail!("--users {shown}: no user is in this file; write a name and a password on a line");
    }
    Ok(users)
}
