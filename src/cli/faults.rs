//! Faults of servos in memory as options, so that what a rig does about them can be rehearsed.

use anyhow::bail;
use clap::Args;
use tdcr::hw::rig::Rig;
use tdcr::hw::simulated::ScheduledFault;

/// Faults of a simulated rig.
#[derive(Debug, Default, Args)]
pub(super) struct FaultArgs {
    /// Let something go wrong with a rig in memory: lost, corrupted, duplicated or late=SHARE of the bytes, silent, overheated,
    /// overloaded, power-cycled, snapped or jammed:ID, unplugged; @S: after so many seconds of the rig's clock. May be given several
    /// times
    #[arg(long = "fault", value_name = "FAULT")]
    faults: Vec<ScheduledFault>,
}

impl FaultArgs {
    /// Refuses any where `option`, which names the rig, is not given.
    pub fn refuse(&self, option: &str) -> anyhow::Result<()> {
        match self.faults.first() {
            Some(fault) => bail!(
                "--fault {} is of a rig; expected {option} beside it",
                fault.fault
            ),
            None => Ok(()),
        }
    }

    /// Schedules them for the rig's servos.
    pub fn schedule(&self, rig: &Rig) -> anyhow::Result<()> {
        let Some(first) = self.faults.first() else {
            return Ok(());
        };
        let Some(simulator) = rig.simulator() else {
            bail!(
                "--fault {}: the servos of rig `{}` are not simulated; expected servos.link = \"simulated\" in its file",
                first.fault,
                rig.spec().name
            );
        };
        let ids: Vec<_> = rig.winches().iter().map(|winch| winch.id).collect();
        for fault in &self.faults {
            if let Some(id) = fault.fault.servo().filter(|id| !ids.contains(id)) {
                let known: Vec<String> = ids.iter().map(ToString::to_string).collect();
                bail!(
                    "--fault {}: there is no servo {id}; the rig's are {}",
                    fault.fault,
                    known.join(", ")
                );
            }
        }
        for fault in &self.faults {
            simulator.schedule(*fault);
        }
        Ok(())
    }
}
