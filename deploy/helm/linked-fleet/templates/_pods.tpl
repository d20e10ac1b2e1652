{{/* Fields of each pod: (dict "root" $ "user" 10001 "placement" .Values.gateways). No part speaks to the API server. */}}
{{- define "lf.pod" -}}
serviceAccountName: {{ include "lf.name" .root }}
automountServiceAccountToken: false
enableServiceLinks: false
securityContext:
  runAsNonRoot: true
  runAsUser: {{ .user }}
  runAsGroup: {{ .user }}
  fsGroup: {{ .user }}
  fsGroupChangePolicy: OnRootMismatch
  seccompProfile: {type: RuntimeDefault}
{{- with .root.Values.images.pullSecrets }}
imagePullSecrets:
  {{- range . }}
  - name: {{ . }}
  {{- end }}
{{- end }}
{{- with .placement.nodeSelector }}
nodeSelector: {{- toYaml . | nindent 2 }}
{{- end }}
{{- with .placement.tolerations }}
tolerations: {{- toYaml . | nindent 2 }}
{{- end }}
{{- end }}

{{/* Fields of each container: (dict "root" $ "image" .Values.images.gateway "resources" …). */}}
{{- define "lf.container" -}}
image: {{ include "lf.image" . | quote }}
imagePullPolicy: {{ .root.Values.images.pullPolicy }}
securityContext:
  allowPrivilegeEscalation: false
  readOnlyRootFilesystem: true
  capabilities: {drop: [ALL]}
resources: {{- toYaml .resources | nindent 2 }}
{{- end }}

{{/* Replicas on different nodes, as far as there are any. */}}
{{- define "lf.spread" -}}
topologySpreadConstraints:
  - maxSkew: 1
    topologyKey: kubernetes.io/hostname
    whenUnsatisfiable: ScheduleAnyway
    labelSelector:
      matchLabels: {{- include "lf.selector" . | nindent 8 }}
{{- end }}

{{/* Variables of an agent's or a gateway's certificate, which is mounted at /etc/linked-fleet/wire. */}}
{{- define "lf.wireEnv" -}}
- {name: LINKED_FLEET_ZENOH_CA, value: /etc/linked-fleet/wire/ca.crt}
- {name: LINKED_FLEET_ZENOH_CERT, value: /etc/linked-fleet/wire/tls.crt}
- {name: LINKED_FLEET_ZENOH_KEY, value: /etc/linked-fleet/wire/tls.key}
{{- end }}

{{/* A variable for each entry of a map. */}}
{{- define "lf.env" -}}
{{- range $name, $value := . }}
- {name: {{ $name }}, value: {{ $value | quote }}}
{{- end }}
{{- end }}
