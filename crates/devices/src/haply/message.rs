//! What is said on the service's simulation channel, as far as a force device needs it.
//!
//! Field names are those of Haply's documentation of the service 3.5; what it sends beyond them is not looked at. Lengths
//! are in metres, forces in newtons, in the frame that the service is configured for (right-handed).

use nalgebra::{Isometry3, Quaternion, Translation3, Unit, UnitQuaternion, Vector3};
use palpate_haptics::device::{DeviceError, DeviceSample};
use palpate_haptics::wrench::Twist;
use serde::Deserialize;
use serde_json::{Value, json};

/// A message of the service: the inventory that it begins with, or a state.
#[derive(Debug, Deserialize)]
pub(super) struct Message {
    /// Only services since 3.5 number their sessions.
    #[serde(default)]
    session_id: Option<Value>,
    #[serde(default)]
    inverse3: Vec<Arm>,
    #[serde(default)]
    verse_grip: Vec<Grip>,
    #[serde(default)]
    wireless_verse_grip: Vec<Grip>,
}

#[derive(Debug, Deserialize)]
struct Arm {
    device_id: String,
    #[serde(default)]
    state: ArmState,
}

#[derive(Debug, Default, Deserialize)]
struct ArmState {
    cursor_position: Option<Xyz>,
    cursor_velocity: Option<Xyz>,
}

#[derive(Debug, Deserialize)]
struct Grip {
    #[serde(default)]
    state: GripState,
}

#[derive(Debug, Default, Deserialize)]
struct GripState {
    orientation: Option<Wxyz>,
    /// Of the grip with a cable.
    #[serde(default)]
    button: bool,
    /// Of the wireless grip.
    #[serde(default)]
    buttons: Buttons,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Buttons {
    a: bool,
    b: bool,
    c: bool,
}

#[derive(Clone, Copy, Debug, Deserialize)]
struct Xyz {
    x: f64,
    y: f64,
    z: f64,
}

impl From<Xyz> for Vector3<f64> {
    fn from(v: Xyz) -> Self {
        Self::new(v.x, v.y, v.z)
    }
}

#[derive(Clone, Copy, Debug, Deserialize)]
struct Wxyz {
    w: f64,
    x: f64,
    y: f64,
    z: f64,
}

/// How a service wants its forces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Dialect {
    /// Since 3.5: `"set_cursor_force": { "vector": ... }`.
    Vector,
    /// Before: `"set_cursor_force": { "values": ... }`.
    Values,
}

/// The arm that was found, and how to speak to it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Address {
    pub(super) device_id: String,
    pub(super) dialect: Dialect,
    pub(super) has_grip: bool,
}

impl Message {
    /// Reads a message.
    pub(super) fn parse(text: &str) -> Result<Self, serde_json::Error> {
        serde_json::from_str(text)
    }

    /// The first arm of an inventory.
    pub(super) fn address(&self) -> Option<Address> {
        let arm = self.inverse3.first()?;
        let dialect = if self.session_id.is_some() { Dialect::Vector } else { Dialect::Values };
        let has_grip = self.grip().is_some();
        Some(Address { device_id: arm.device_id.clone(), dialect, has_grip })
    }

    fn grip(&self) -> Option<&GripState> {
        self.wireless_verse_grip.first().or(self.verse_grip.first()).map(|grip| &grip.state)
    }

    /// What the arm of this name measured.
    pub(super) fn sample(&self, device_id: &str) -> Result<DeviceSample, DeviceError> {
        let arm = self.inverse3.iter().find(|arm| arm.device_id == device_id).ok_or(DeviceError::Disconnected)?;
        let position: Vector3<f64> = arm.state.cursor_position.ok_or(DeviceError::Malformed)?.into();
        let linear = arm.state.cursor_velocity.map_or_else(Vector3::zeros, Vector3::from);
        let grip = self.grip();
        let buttons = grip.map_or(0, |grip| {
            let pressed = [grip.button || grip.buttons.a, grip.buttons.b, grip.buttons.c];
            pressed.iter().enumerate().map(|(bit, &on)| u32::from(on) << bit).sum()
        });
        let rotation = grip.and_then(|grip| grip.orientation).map_or(Some(UnitQuaternion::identity()), |q| {
            // A grip sends sixteen bits a number: of unit length to four digits only.
            Unit::try_new(Quaternion::new(q.w, q.x, q.y, q.z), 0.5)
        });
        let pose = Isometry3::from_parts(Translation3::from(position), rotation.ok_or(DeviceError::Malformed)?);
        let velocity = Twist { linear, ..Twist::default() };
        Ok(DeviceSample { velocity, buttons, ..DeviceSample::at_rest(0.0, pose) })
    }
}

/// The command that asks for a force; the first of a session also says who asks.
pub(super) fn command(address: &Address, force: &Vector3<f64>, first: bool) -> String {
    let force = json!({ "x": force.x, "y": force.y, "z": force.z });
    let key = match address.dialect {
        Dialect::Vector => "vector",
        Dialect::Values => "values",
    };
    let mut message = json!({
        "inverse3": [{ "device_id": address.device_id, "commands": { "set_cursor_force": { key: force } } }]
    });
    if first {
        message["session"] = json!({ "configure": { "profile": { "name": "palpate" } } });
    }
    message.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Shortened from the documentation.
    const INVENTORY: &str = r#"{
        "session_id": 7,
        "inverse3": [{
            "device_id": "049D",
            "config": { "type": "inverse3", "port": "COM12", "handedness": "right" },
            "state": {
                "cursor_position": { "x": 0.01, "y": -0.12, "z": 0.15 },
                "cursor_velocity": { "x": 0.1, "y": 0.0, "z": -0.2 },
                "control_mode": "idle"
            },
            "status": { "calibrated": true, "ready": true }
        }],
        "wireless_verse_grip": [{
            "device_id": "61548",
            "state": {
                "orientation": { "x": 0.0, "y": 0.7071, "z": 0.0, "w": 0.7071 },
                "buttons": { "a": true, "b": false, "c": true }
            }
        }]
    }"#;

    #[test]
    fn the_documented_inventory_is_understood() {
        let message = Message::parse(INVENTORY).unwrap();
        let address = message.address().unwrap();
        let expected = Address { device_id: "049D".into(), dialect: Dialect::Vector, has_grip: true };
        assert_eq!(address, expected);
        let sample = message.sample("049D").unwrap();
        assert_eq!(sample.pose.translation.vector, Vector3::new(0.01, -0.12, 0.15));
        assert_eq!(sample.velocity.linear, Vector3::new(0.1, 0.0, -0.2));
        assert_eq!(sample.buttons, 0b101);
        let turned = sample.pose.rotation * Vector3::x();
        assert!((turned + Vector3::z()).norm() < 1e-12, "a quarter turn about y, of unit length: {turned}");
    }

    #[test]
    fn an_arm_that_has_gone_and_a_state_without_position_are_told_apart() {
        let message = Message::parse(INVENTORY).unwrap();
        assert_eq!(message.sample("0000"), Err(DeviceError::Disconnected));
        let bare = Message::parse(r#"{ "inverse3": [{ "device_id": "049D", "state": {} }] }"#).unwrap();
        assert_eq!(bare.sample("049D"), Err(DeviceError::Malformed));
        assert_eq!(Message::parse("{}").unwrap().address(), None);
        let flat = INVENTORY.replace("0.7071", "0.0");
        assert_eq!(Message::parse(&flat).unwrap().sample("049D"), Err(DeviceError::Malformed), "no rotation");
    }

    #[test]
    fn commands_are_those_of_the_service_s_version() {
        let mut address = Message::parse(INVENTORY).unwrap().address().unwrap();
        let text = command(&address, &Vector3::new(0.0, -1.5, 2.0), true);
        let value: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(value["session"]["configure"]["profile"]["name"], "palpate");
        let arm = &value["inverse3"][0];
        assert_eq!(arm["device_id"], "049D");
        assert_eq!(arm["commands"]["set_cursor_force"]["vector"], json!({ "x": 0.0, "y": -1.5, "z": 2.0 }));
        address.dialect = Dialect::Values;
        let value: Value = serde_json::from_str(&command(&address, &Vector3::zeros(), false)).unwrap();
        assert_eq!(value["inverse3"][0]["commands"]["set_cursor_force"]["values"]["y"], 0.0);
        assert!(value.get("session").is_none());
    }
}
