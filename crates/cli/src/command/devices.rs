//! `palpate devices`.

use miette::Result;
use palpate::devices::PORT;
use palpate::drivers::{DRIVERS, DriverConfig};
use palpate::haptics::device::DEVICES;

use crate::arguments::DevicesArguments;
use crate::output::say;

pub(crate) fn devices(arguments: &DevicesArguments) -> Result<u8> {
    for device in DEVICES {
        line(device.name, "built in", device.summary)?;
    }
    line(PORT, "built in", "a program that embeds the C library ticks in its own thread")?;
    for driver in DRIVERS {
        if driver.keys.contains(&"trace") {
            line(driver.name, "built in", driver.summary)?;
            continue;
        }
        let library = match driver.name {
            "force_dimension" => arguments.dhd.clone(),
            "openhaptics" => arguments.hd.clone(),
            _ => None,
        };
        let url = arguments.haply.clone().filter(|_| driver.keys.contains(&"url"));
        match (driver.probe)(&DriverConfig { library, url, ..DriverConfig::default() }) {
            Ok(found) => line(driver.name, "found", &format!("{found}; {}", driver.summary))?,
            Err(reason) => line(driver.name, "not found", &reason.to_string())?,
        }
    }
    Ok(0)
}

fn line(name: &str, state: &str, text: &str) -> Result<()> {
    say(format_args!("{name:16} {state:10} {text}"))
}
