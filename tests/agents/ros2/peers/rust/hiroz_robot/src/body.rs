//! What the robot is: its state, topics and services.
use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex},
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use hiroz::{
    Builder, Result,
    node::ZNode,
    pubsub::ZPub,
    qos::{QosDurability, QosHistory, QosProfile},
    service::ZServer,
};

use hiroz_msgs::{
    builtin_interfaces::Time,
    diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue},
    geometry_msgs::TransformStamped,
    sensor_msgs::{BatteryState, JointState},
    std_msgs::{Bool, Header, String as Text},
    std_srvs::{
        SetBoolResponse, TriggerResponse,
        srv::{SetBool, Trigger},
    },
    tf2_msgs::TFMessage,
    trajectory_msgs::JointTrajectory,
};

use crate::types::ros::controller_manager_msgs::{ControllerState, ListControllersResponse, srv::ListControllers};

const PERIOD: Duration = Duration::from_millis(10);
const STEP: f64 = 0.01;

#[derive(Clone, Default)]
pub struct State {
    pub positions: BTreeMap<String, f64>,
    pub goals: BTreeMap<String, f64>,
    pub base: (f64, f64, f64),
    pub lamp: bool,
}

/// What the robot is and does. It also has so many `more` joints, which swing to and fro and take no commands.
pub struct Body {
    state: Mutex<State>,
    more: usize,
}

impl Body {
    pub fn new(more: usize) -> Self {
        let positions = [("pan", 0.25), ("lift", 0.0), ("finger", 0.08)].map(|(name, at)| (name.to_string(), at));
        Self { state: Mutex::new(State { positions: positions.into(), ..Default::default() }), more }
    }

    pub fn with<T>(&self, change: impl FnOnce(&mut State) -> T) -> T {
        change(&mut self.state.lock().expect("no other thread panicked"))
    }

    fn step(&self) -> JointState {
        self.with(|state| {
            for (name, goal) in state.goals.clone() {
                if let Some(at) = state.positions.get_mut(&name) {
                    *at += (goal - *at).clamp(-STEP, STEP);
                }
            }
            let (mut name, mut position): (Vec<_>, Vec<_>) = state.positions.clone().into_iter().unzip();
            let header = header("");
            let at = f64::from(header.stamp.sec % 1000) + f64::from(header.stamp.nanosec) / 1e9;
            name.extend((0..self.more).map(|number| format!("j{number}")));
            position.extend((0..self.more).map(|number| 0.3 * (at + number as f64).sin()));
            let row = vec![0.0; if self.more > 0 { name.len() } else { 0 }];
            JointState { header, name, position, velocity: row.clone(), effort: row }
        })
    }
}

pub fn header(frame: &str) -> Header {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).expect("after 1970");
    Header { stamp: Time { sec: now.as_secs() as i32, nanosec: now.subsec_nanos() }, frame_id: frame.into() }
}

type Publisher<T> = Arc<ZPub<T, <T as hiroz::msg::ZMessage>::Serdes>>;

pub struct Topics {
    pub lamp: Publisher<Bool>,
    _description: Publisher<Text>,
}

pub fn latched() -> QosProfile {
    QosProfile { durability: QosDurability::TransientLocal, history: QosHistory::from_depth(1), ..Default::default() }
}

pub fn publish(node: &ZNode, body: Arc<Body>, urdf: String) -> Result<Topics> {
    let description = Arc::new(node.create_pub::<Text>("robot_description").with_qos(latched()).build()?);
    description.publish(&Text { data: urdf })?;
    let lamp = Arc::new(node.create_pub::<Bool>("lamp").with_qos(latched()).build()?);
    lamp.publish(&Bool { data: false })?;
    let states = node.create_pub::<JointState>("joint_states").build()?;
    let transforms = node.create_pub::<TFMessage>("tf").build()?;
    let battery = node.create_pub::<BatteryState>("battery_state").build()?;
    let diagnostics = node.create_pub::<DiagnosticArray>("diagnostics").build()?;
    let moving = body.clone();
    tokio::spawn(async move {
        let mut ticks = tokio::time::interval(PERIOD);
        for count in 0u64.. {
            ticks.tick().await;
            states.publish(&moving.step()).expect("a session");
            if count % 10 == 0 {
                transforms.publish(&poses(&moving)).expect("a session");
            }
            if count % 50 == 0 {
                battery.publish(&charge()).expect("a session");
                diagnostics.publish(&health()).expect("a session");
            }
        }
    });
    follow(node, body)?;
    Ok(Topics { lamp, _description: description })
}

/// Obey the topic of the trajectory controller, as its action does.
fn follow(node: &ZNode, body: Arc<Body>) -> Result<()> {
    let commands = node.create_sub::<JointTrajectory>("joint_trajectory_controller/joint_trajectory").build()?;
    tokio::spawn(async move {
        while let Ok(said) = commands.async_recv().await {
            if let Some(last) = said.points.last() {
                body.with(|state| state.goals = said.joint_names.iter().cloned().zip(last.positions.clone()).collect());
            }
        }
    });
    Ok(())
}

fn poses(body: &Body) -> TFMessage {
    let (x, y, yaw) = body.with(|state| state.base);
    let mut base = TransformStamped { header: header("odom"), child_frame_id: "base".into(), ..Default::default() };
    (base.transform.translation.x, base.transform.translation.y) = (x, y);
    (base.transform.rotation.z, base.transform.rotation.w) = (f64::sin(yaw / 2.0), f64::cos(yaw / 2.0));
    let mut map = TransformStamped { header: header("map"), child_frame_id: "odom".into(), ..Default::default() };
    (map.transform.translation.x, map.transform.rotation.w) = (1.0, 1.0);
    TFMessage { transforms: vec![map, base] }
}

fn charge() -> BatteryState {
    BatteryState {
        header: header(""),
        voltage: 24.5,
        percentage: 0.75,
        power_supply_status: BatteryState::POWER_SUPPLY_STATUS_DISCHARGING,
        present: true,
        ..Default::default()
    }
}

fn health() -> DiagnosticArray {
    let values = vec![KeyValue { key: "temperature".into(), value: "41".into() }];
    let (level, name, message) = (DiagnosticStatus::WARN, "motor".into(), "warm".into());
    let status = DiagnosticStatus { level, name, message, values, ..Default::default() };
    DiagnosticArray { header: header(""), status: vec![status] }
}

pub struct Services {
    _silent: ZServer<Trigger>,
}

pub fn serve(node: &ZNode, body: Arc<Body>, said: Publisher<Bool>) -> Result<Services> {
    let mut lamp = node.create_service::<SetBool>("set_lamp").build()?;
    let lit = body.clone();
    tokio::spawn(async move {
        while let Ok(request) = lamp.async_take_request().await {
            let data = request.message().data;
            let changed = lit.with(|state| std::mem::replace(&mut state.lamp, data) != data);
            said.publish(&Bool { data }).expect("a session");
            let message = if changed { "switched" } else { "as it was" }.into();
            request.reply(&SetBoolResponse { success: changed, message }).await.expect("a session");
        }
    });
    let mut home = node.create_service::<Trigger>("home").build()?;
    tokio::spawn(async move {
        while let Ok(request) = home.async_take_request().await {
            body.with(|state| state.goals = ["pan", "lift"].map(|name| (name.to_string(), 0.0)).into());
            let response = TriggerResponse { success: true, message: "on its way".into() };
            request.reply(&response).await.expect("a session");
        }
    });
    let mut list = node.create_service::<ListControllers>("controller_manager/list_controllers").build()?;
    tokio::spawn(async move {
        while let Ok(request) = list.async_take_request().await {
            request.reply(&ListControllersResponse { controller: controllers() }).await.expect("a session");
        }
    });
    Ok(Services { _silent: node.create_service::<Trigger>("silence").build()? })
}

fn controllers() -> Vec<ControllerState> {
    let controller = |name: &str, state: &str, kind: &str, interfaces: &[&str]| ControllerState {
        name: name.into(),
        state: state.into(),
        r#type: kind.into(),
        #[cfg(not(feature = "humble"))]
        update_rate: 100,
        claimed_interfaces: interfaces.iter().map(|each| each.to_string()).collect(),
        required_command_interfaces: interfaces.iter().map(|each| each.to_string()).collect(),
        ..Default::default()
    };
    let trajectory = "joint_trajectory_controller/JointTrajectoryController";
    vec![
        controller("joint_trajectory_controller", "active", trajectory, &["pan/position", "lift/position"]),
        controller(
            "gripper_controller",
            "active",
            "position_controllers/GripperActionController",
            &["finger/position"],
        ),
        controller("forward_velocity_controller", "inactive", "velocity_controllers/JointGroupVelocityController", &[]),
        controller("joint_state_broadcaster", "active", "joint_state_broadcaster/JointStateBroadcaster", &[]),
    ]
}
