//! The settings of the rig and whether it is armed, as parameters that viewers read.
//!
//! None can be set. A setting is a line of the rig file, and the services arm and disarm.

use crate::serve::app::App;
use foxglove::WebSocketServerHandle;
use foxglove::websocket::{
    AnyClient, GetParametersResponder, Parameter, ParameterHandler, ParameterValue, SetParametersResponder,
};
use serde_json::Value;
use std::sync::Arc;

/// The name of the parameter that shows whether the rig is armed.
const ARMED: &str = "armed";

/// The parameters of a rig.
pub(super) struct Parameters {
    app: Arc<App>,
    /// The settings of the rig file, by the names of their keys: `camera.frame_rate_hz`, `body.0.diameter_mm`.
    settings: Vec<Parameter>,
}

impl Parameters {
    pub(super) fn new(app: Arc<App>) -> Self {
        let mut settings = Vec::new();
        // The text was read as a rig file before.
        if let Ok(table) = toml::from_str::<toml::Table>(&app.config.text) {
            add_settings("", &toml::Value::Table(table), &mut settings);
        }
        Self { app, settings }
    }

    /// Returns the parameters with these names, or all if none are given.
    fn named(&self, names: &[String]) -> Vec<Parameter> {
        let armed = armed(&self.app.state.borrow().json());
        let all = self.settings.iter().cloned().chain(armed);
        all.filter(|parameter| names.is_empty() || names.contains(&parameter.name)).collect()
    }
}

impl ParameterHandler for Parameters {
    fn get(&self, _client: AnyClient, names: Vec<String>, _id: Option<String>, responder: GetParametersResponder) {
        responder.respond(self.named(&names));
    }

    fn set(
        &self,
        _client: AnyClient,
        parameters: Vec<Parameter>,
        _id: Option<String>,
        responder: SetParametersResponder,
    ) {
        let names: Vec<String> = parameters.into_iter().map(|parameter| parameter.name).collect();
        // Without a name, all would be meant.
        responder.respond(if names.is_empty() { Vec::new() } else { self.named(&names) });
    }
}

/// Publishes whether the rig is armed at each change, until the state of the rig ends.
pub(super) async fn publish_armed(server: WebSocketServerHandle, app: Arc<App>) {
    let mut state = app.state.subscribe();
    let mut last = None;
    while state.changed().await.is_ok() {
        let parameter = armed(&state.borrow_and_update().json());
        if parameter != last {
            server.publish_parameter_values(parameter.iter().cloned().collect());
            last = parameter;
        }
    }
}

/// Returns whether the rig is armed in this state; `None` until it is known.
fn armed(state: &[u8]) -> Option<Parameter> {
    let state: Value = serde_json::from_slice(state).ok()?;
    Some(Parameter::bool(ARMED, state[ARMED].as_bool()?))
}

/// Adds the settings below a key, each with its full name. A list of tables numbers them from 0.
fn add_settings(name: &str, value: &toml::Value, settings: &mut Vec<Parameter>) {
    let below = |key: &str| if name.is_empty() { key.to_owned() } else { format!("{name}.{key}") };
    match value {
        toml::Value::Table(table) => table.iter().for_each(|(key, value)| add_settings(&below(key), value, settings)),
        toml::Value::Array(list) if list.iter().any(toml::Value::is_table) => {
            for (number, value) in list.iter().enumerate() {
                add_settings(&below(&number.to_string()), value, settings);
            }
        }
        value => settings.push(Parameter { name: name.to_owned(), r#type: None, value: Some(parameter_value(value)) }),
    }
}

/// Returns the value of a setting.
fn parameter_value(value: &toml::Value) -> ParameterValue {
    match value {
        toml::Value::Integer(number) => ParameterValue::Integer(*number),
        toml::Value::Float(number) => ParameterValue::Float64(*number),
        toml::Value::Boolean(is_on) => ParameterValue::Bool(*is_on),
        toml::Value::Array(list) => ParameterValue::Array(list.iter().map(parameter_value).collect()),
        toml::Value::String(text) => ParameterValue::String(text.clone()),
        other => ParameterValue::String(other.to_string()),
    }
}
