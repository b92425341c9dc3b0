//! The way into an MQTT broker: user, password and certificates.

use crate::config::Broker;
use crate::failure::{ExitCode, Fatal};
use rumqttc::{ConnectReturnCode, ConnectionError, MqttOptions, TlsConfiguration, Transport};
use std::fmt;
use std::path::Path;

/// The start of a certificate in a PEM file.
const CERTIFICATE: &str = "-----BEGIN CERTIFICATE-----";
/// The maximum length of a password, bytes.
const MAX_PASSWORD_BYTES: usize = 65_535;

/// A broker with its password and certificates. It prints without the password.
#[derive(Clone)]
pub(super) struct Login {
    pub(super) broker: Broker,
    password: String,
    /// The certificates (PEM); `None` without encryption.
    certificates: Option<Vec<u8>>,
}

/// A file of the MQTT broker cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("cannot use serve.{key} {path}: {reason}")]
pub(super) struct LoginError {
    key: &'static str,
    path: String,
    reason: String,
}

impl Fatal for LoginError {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Usage
    }
}

impl fmt::Debug for Login {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Login").field("broker", &self.broker).finish_non_exhaustive()
    }
}

/// A file that the rig file names.
#[derive(Debug, Clone, Copy)]
struct LoginFile<'a> {
    key: &'static str,
    path: &'a Path,
}

impl LoginFile<'_> {
    /// Reads the file as text.
    fn read(self) -> Result<String, LoginError> {
        std::fs::read_to_string(self.path).map_err(|error| self.refuse(error.to_string()))
    }

    /// Returns the error that refuses the file.
    fn refuse(self, reason: String) -> LoginError {
        LoginError { key: self.key, path: self.path.display().to_string(), reason }
    }
}

impl Login {
    /// Reads the password, which is the first line of its file, and the certificates.
    ///
    /// # Errors
    ///
    /// [`LoginError`] when a file cannot be read, the password is empty, or there is no certificate.
    pub(super) fn read(broker: &Broker) -> Result<Self, LoginError> {
        let mut login = Self { broker: broker.clone(), password: String::new(), certificates: None };
        if let Some(path) = &broker.password_file {
            let file = LoginFile { key: "mqtt_password_file", path };
            let text = file.read()?;
            text.lines().next().unwrap_or_default().clone_into(&mut login.password);
            if !(1..=MAX_PASSWORD_BYTES).contains(&login.password.len()) {
                return Err(
                    file.refuse(format!("its first line must be a password of 1 to {MAX_PASSWORD_BYTES} bytes"))
                );
            }
        }
        if let Some(path) = &broker.ca_file {
            let file = LoginFile { key: "mqtt_ca_file", path };
            let text = file.read()?;
            if !text.contains(CERTIFICATE) {
                return Err(file.refuse("it has no certificate in the PEM format".to_owned()));
            }
            login.certificates = Some(text.into_bytes());
        }
        Ok(login)
    }

    /// Sets user, password and encryption of a connection.
    pub(super) fn apply(&self, options: &mut MqttOptions) {
        if let Some(user) = &self.broker.user {
            options.set_credentials(user, &self.password);
        }
        if let Some(ca) = self.certificates.clone() {
            options.set_transport(Transport::Tls(TlsConfiguration::Simple { ca, alpn: None, client_auth: None }));
        }
    }

    /// Describes a failed connection in one line, with the keys to look at if the broker or its certificate is refused.
    pub(super) fn explain(&self, error: &ConnectionError) -> String {
        let broker = &self.broker;
        match (error, &broker.user) {
            (error, Some(user)) if is_refusal(error) => format!(
                "the MQTT broker {broker} refuses the user {user:?}: check serve.mqtt_user and the password in \
                 serve.mqtt_password_file"
            ),
            (error, None) if is_refusal(error) => {
                format!("the MQTT broker {broker} asks for a user: set serve.mqtt_user and serve.mqtt_password_file")
            }
            (ConnectionError::Tls(reason), _) => {
                format!("cannot reach the MQTT broker {broker} by TLS: {reason}; check serve.mqtt_ca_file")
            }
            _ => format!("cannot reach the MQTT broker {broker}: {error}"),
        }
    }
}

/// Whether the broker has refused the user or the password.
pub(super) fn is_refusal(error: &ConnectionError) -> bool {
    use ConnectReturnCode::{BadUserNamePassword, NotAuthorized};
    matches!(error, ConnectionError::ConnectionRefused(BadUserNamePassword | NotAuthorized))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PASSWORD: &str = "correct horse";

    #[test]
    fn a_password_is_the_first_line_of_its_file_and_is_never_printed() {
        let folder = tempfile::tempdir().unwrap();
        let [password, ca] = ["password", "ca.pem"].map(|name| folder.path().join(name));
        let broker = Broker {
            host: "broker.local".into(),
            port: 8883,
            user: Some("rig".into()),
            password_file: Some(password.clone()),
            ca_file: None,
        };
        assert!(Login::read(&broker).unwrap_err().to_string().starts_with("cannot use serve.mqtt_password_file "));
        std::fs::write(&password, "\nsecond").unwrap();
        assert!(Login::read(&broker).unwrap_err().reason.contains("1 to 65535 bytes"));
        std::fs::write(&password, format!("{PASSWORD}\nnotes")).unwrap();
        let login = Login::read(&broker).unwrap();
        assert_eq!(login.password, PASSWORD);
        let refused = login.explain(&ConnectionError::ConnectionRefused(ConnectReturnCode::NotAuthorized));
        assert!(refused.starts_with("the MQTT broker broker.local:8883 refuses the user \"rig\""), "{refused}");
        assert!(!format!("{login:?}{refused}").contains(PASSWORD));
        std::fs::write(&ca, "no certificate").unwrap();
        let encrypted = Broker { ca_file: Some(ca), ..broker };
        assert!(Login::read(&encrypted).unwrap_err().reason.contains("PEM"));
    }
}
