//! Address and access of the console: the configuration's settings, checked before a session
//! begins.
//!
//! Other machines reach the console by TLS only, and need a token.

use std::fs::File;
use std::io::Read as _;
use std::net::SocketAddr;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::sync::Arc;

use rustls_pki_types::pem::PemObject as _;
use rustls_pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::{self, ServerConfig, crypto};

use config::bedside::Access;

use super::access::Gate;
use super::error::ConsoleError;
use super::token::Token;

/// Largest size of a certificate or key file, bytes.
const MOST_BYTES: u64 = 1 << 20;

/// Address and access settings of the console.
#[derive(Debug, Clone)]
pub struct Listen {
    /// The address; port 0 takes any free port.
    pub address: SocketAddr,
    /// Certificate, tokens and names.
    pub access: Access,
}

impl From<SocketAddr> for Listen {
    fn from(address: SocketAddr) -> Self {
        Self { address, access: Access::default() }
    }
}

/// TLS, tokens and names of the listening server.
pub(super) struct Door {
    pub(super) tls: Option<TlsAcceptor>,
    token: Option<Token>,
    metrics_token: Option<Token>,
    names: Vec<String>,
}

impl Listen {
    /// Checks these settings without binding the address.
    ///
    /// # Errors
    /// [`ConsoleError`] for an address that other machines reach without TLS and a token, and
    /// for unusable files.
    pub fn check(&self) -> Result<(), ConsoleError> {
        self.door().map(drop)
    }

    pub(super) fn door(&self) -> Result<Door, ConsoleError> {
        let Access { certificate, key, token_file, metrics_token_file, names } = &self.access;
        let given = [("certificate", certificate), ("key", key), ("token_file", token_file)];
        if !self.address.ip().is_loopback() {
            let missing: Vec<&str> = given.iter().filter(|(_, path)| path.is_none()).map(|(name, _)| *name).collect();
            let those = if missing.len() == 1 { "it" } else { "them" };
            if !missing.is_empty() {
                let missing = match missing.as_slice() {
                    [head @ .., last] if !head.is_empty() => format!("{} and no {last}", head.join(", no ")),
                    _ => missing.concat(),
                };
                return Err(ConsoleError::Open { address: self.address, missing, those });
            }
        }
        let mut names = names.clone();
        let tls = match (certificate, key) {
            (Some(certificate), Some(key)) => {
                let (tls, own) = tls(certificate, key)?;
                names.extend(own);
                Some(tls)
            }
            (None, None) => None,
            (Some(_), None) => return Err(ConsoleError::Half { has: "certificate", lacks: "key" }),
            (None, Some(_)) => return Err(ConsoleError::Half { has: "key", lacks: "certificate" }),
        };
        let read = |key, path: &Path| Token::read(path).map_err(|why| unfit(key, path, why));
        let token = token_file.as_ref().map(|path| read("token_file", path)).transpose()?;
        let metrics_token = match (&token, metrics_token_file) {
            (Some(token), Some(path)) => {
                let own = read("metrics_token_file", path)?;
                if own.same(token) {
                    let problem = "holds the token of token_file, which gives everything; make another by `openssl \
                        rand -hex 32`";
                    return Err(unfit("metrics_token_file", path, problem));
                }
                Some(own)
            }
            (_, None) => None,
            (None, Some(_)) => return Err(ConsoleError::Half { has: "metrics_token_file", lacks: "token_file" }),
        };
        Ok(Door { tls, token, metrics_token, names })
    }
}

impl Door {
    /// Creates the authentication of a server that listens at this port.
    pub(super) fn gate(&self, port: u16) -> Gate {
        Gate::new(self.token.clone(), self.metrics_token.clone(), self.names.clone(), self.tls.is_some(), port)
    }

    /// Returns a name of this machine, if it has one.
    pub(super) fn name(&self) -> Option<&str> {
        self.names.iter().map(String::as_str).find(|name| !name.starts_with('*'))
    }
}

fn unfit(key: &'static str, path: &Path, problem: impl Into<String>) -> ConsoleError {
    ConsoleError::File { key, path: path.to_owned(), problem: problem.into() }
}

/// Returns TLS from a certificate and its key, and the names in the certificate.
fn tls(certificate: &Path, key: &Path) -> Result<(TlsAcceptor, Vec<String>), ConsoleError> {
    let bad_certificate = |why: String| unfit("certificate", certificate, why);
    let bad_key = |why: String| unfit("key", key, why);
    let (text, _) = read(certificate).map_err(bad_certificate)?;
    let chain = CertificateDer::pem_slice_iter(&text).collect::<Result<Vec<_>, _>>();
    let chain = chain.map_err(|error| bad_certificate(format!("is not PEM: {error}")))?;
    let Some(first) = chain.first() else {
        return Err(bad_certificate(
            "holds no certificate in PEM, which begins with -----BEGIN CERTIFICATE-----".into(),
        ));
    };
    let own = webpki::EndEntityCert::try_from(first)
        .map_err(|error| bad_certificate(format!("its first certificate cannot be read: {error}")))?;
    let names: Vec<String> = own.valid_dns_names().map(str::to_ascii_lowercase).collect();

    let (text, mode) = read(key).map_err(bad_key)?;
    if mode & 0o007 != 0 {
        let mode = mode & 0o777;
        return Err(bad_key(format!(
            "all users may read or write it (mode {mode:o}); run chmod o=, and make a new key if another user has read \
            it"
        )));
    }
    let secret = PrivateKeyDer::from_pem_slice(&text).map_err(|_| {
        bad_key("holds no private key in PEM without a password, which begins with -----BEGIN PRIVATE KEY-----".into())
    })?;
    let mut config = ServerConfig::builder_with_provider(Arc::new(crypto::ring::default_provider()))
        .with_safe_default_protocol_versions()
        .and_then(|config| config.with_no_client_auth().with_single_cert(chain.clone(), secret))
        .map_err(|error| match error {
            rustls::Error::InconsistentKeys(_) => bad_key("does not belong to the certificate".into()),
            other => bad_key(format!("certificate and key cannot be used: {other}")),
        })?;
    config.alpn_protocols = vec![b"http/1.1".to_vec()];
    Ok((TlsAcceptor::from(Arc::new(config)), names))
}

/// Returns a file's bytes and its mode.
fn read(path: &Path) -> Result<(Vec<u8>, u32), String> {
    let cannot = |error: std::io::Error| format!("cannot be read: {error}");
    if !path.metadata().map_err(cannot)?.is_file() {
        return Err("is not a file; give one".into());
    }
    let file = File::open(path).map_err(cannot)?;
    let mode = file.metadata().map_err(cannot)?.permissions().mode();
    let mut bytes = Vec::new();
    file.take(MOST_BYTES + 1).read_to_end(&mut bytes).map_err(cannot)?;
    if bytes.len() as u64 > MOST_BYTES {
        return Err(format!("is longer than {MOST_BYTES} bytes; give the file of a certificate or a key"));
    }
    Ok((bytes, mode))
}
