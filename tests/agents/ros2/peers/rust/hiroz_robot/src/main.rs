//! A robot on rmw_zenoh by the crate hiroz: joints, a gripper, a mobile base, services and actions.
//! hiroz_robot ROUTER_ENDPOINT PAUSE_S URDF_FILE: the seconds between two steps of an action. With MORE_JOINTS in its
//! environment it has so many joints more, j0 and so on, which swing to and fro.
mod actions;
mod body;
mod cancelling;

#[allow(dead_code, clippy::all)]
mod types {
    include!(concat!(env!("OUT_DIR"), "/generated.rs"));
}
#[allow(unused_imports)] // by the generated types
use hiroz_msgs::size_estimation;

use std::{sync::Arc, time::Duration};

use hiroz::{Builder, Result, context::ZContextBuilder};
use serde_json::json;

use crate::body::Body;

#[tokio::main]
async fn main() -> Result<()> {
    zenoh::init_log_from_env_or("error");
    let [_, endpoint, pause, urdf] = std::env::args().collect::<Vec<_>>().try_into().expect("see the first lines");
    let pause = Duration::from_secs_f64(pause.parse().expect("seconds"));
    let urdf = std::fs::read_to_string(urdf).expect("a URDF");
    let context = ZContextBuilder::default()
        .with_connect_endpoints([endpoint])
        .with_json("listen/endpoints", Vec::<String>::new())
        .with_json("connect/timeout_ms", -1)
        .with_json("connect/exit_on_failure", false)
        .with_json("connect/retry", json!({"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2}))
        .build()?;
    let node = context.create_node("hiroz_robot");
    // Nodes of Humble do not describe their types.
    #[cfg(not(feature = "humble"))]
    let node = node.with_type_description_service();
    let node = node.build()?;
    let more = std::env::var("MORE_JOINTS").map_or(0, |count| count.parse().expect("a number of joints"));
    let body = Arc::new(Body::new(more));
    let topics = body::publish(&node, body.clone(), urdf)?;
    let services = body::serve(&node, body.clone(), topics.lamp.clone())?;
    actions::serve(&node, body, pause)?;
    println!("{{\"ready\": \"hiroz_robot\"}}");
    tokio::signal::ctrl_c().await?;
    drop((topics, services));
    Ok(())
}
